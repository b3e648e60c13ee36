"""The cost model: what one of each costs a server, and from it what any traffic does."""

from dataclasses import dataclass

from tests.bench.traffic import Load, Tally, Traffic


@dataclass(frozen=True, slots=True)
class Costs:
    """Processor seconds: of a second of nothing, of a post, of a dashboard's poll and its share of a question, of an
    update, and of a post at the location that an open viewer shows, for that viewer. disk: bytes a post leaves."""

    idle: float
    post: float
    poll: float
    update: float
    viewed: float
    disk: float

    def cpu_s(self, done: Tally, viewers: int, locations: int) -> float:
        """What this traffic takes, the posts of which are spread over some locations; viewers show one of them."""
        count = done.done
        return (
            self.idle * done.seconds
            + self.post * count["post"]
            + self.poll * count["poll"]
            + self.update * count["update"]
            + self.viewed * viewers * count["post"] / locations
        )

    def bytes(self, done: Tally) -> float:
        """What it leaves on the disk."""
        return self.disk * done.done["post"]


def measured(load: Load, one: Load, length_s: float) -> Costs:
    """Each alone, posts at a rate at which some share a commit. `one`: with one location only."""
    idle = load.run(Traffic(), length_s)
    base = idle.cpu_s / idle.seconds

    def more(tally: Tally) -> float:
        """Beyond doing nothing."""
        return tally.cpu_s - base * tally.seconds

    posts = load.run(Traffic(robots=25), length_s)
    post = more(posts) / posts.done["post"]
    polls = load.run(Traffic(dashboards=5), length_s)
    updates = load.run(Traffic(updates=2), 0.0)
    viewed = one.run(Traffic(robots=10, viewers=2), length_s)
    drawn = more(viewed) - post * viewed.done["post"]
    return Costs(
        idle=base,
        post=post,
        poll=more(polls) / polls.done["poll"],
        update=more(updates) / updates.done["update"],
        viewed=drawn / (2 * viewed.done["post"]),
        disk=posts.disk / posts.done["post"],
    )
