"""Events as they happen. Start a server first: `make run`. It ends after the first update of the door."""

import threading

from tidemap import Client


def work(tidemap: Client) -> None:
    """What a robot and an operator do meanwhile."""
    door = tidemap.location("followed-door")
    while not done.wait(0.5):
        door.observe([3600.0 * hour for hour in range(48)], [hour % 2 for hour in range(48)])
        door.update()


done = threading.Event()
with Client("http://127.0.0.1:8000") as tidemap:
    tidemap.create_location("followed-door", interval_s=3600)
    worker = threading.Thread(target=work, args=(tidemap,))
    worker.start()
    # It connects again by itself when the connection breaks, and resumes behind the last anomaly.
    for message in tidemap.events(location="followed-door"):
        print(message.kind, message.location)
        if message.kind == "update":
            break
    done.set()
    worker.join()
