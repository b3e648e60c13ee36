"""Many doors at once with asyncio. Start a server first: `make run`."""

import asyncio

from tidemap import AsyncClient

DOORS = [f"async-door-{n}" for n in range(5)]


async def tomorrow_of(tidemap: AsyncClient, name: str) -> float:
    """Make a door, post a day of it, and ask for noon of the next day."""
    door = await tidemap.create_location(name, interval_s=3600)
    await door.observe([3600.0 * hour for hour in range(24)], [8 <= hour < 18 for hour in range(24)])
    await door.update()
    answer = await door.predict(86400 + 12 * 3600)
    return float(answer.probability[0, 0])


async def main() -> None:
    """All doors, each on its own."""
    async with AsyncClient("http://127.0.0.1:8000") as tidemap:
        chances = await asyncio.gather(*(tomorrow_of(tidemap, name) for name in DOORS))
    for name, chance in zip(DOORS, chances, strict=True):
        print(f"{name} {chance:.2f}")


asyncio.run(main())
