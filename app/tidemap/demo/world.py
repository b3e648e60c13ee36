"""The simulated building: a pure function of its seed and the time."""

from tidemap.demo import plan
from tidemap.demo.chance import draw
from tidemap.demo.civil import THURSDAY, TUESDAY, Moment, moment
from tidemap.demo.people import LAB_TEAM, OFFICE_TEAM, Habits, Whereabouts, guests, hours, whereabouts
from tidemap.demo.plan import Cells, Seat, fill
from tidemap.demo.story import Story, within

_OFFICE, _LAB, _GUESTS, _CHAIR, _MAIN_DOOR = range(5)
DOOR_SLOT_S = 300.0
WEEK_OF_SHIFTS = (0, 0, 0, -1, -1, 1, 1)


class World:
    """A building of `plan.SHAPE` cells, 0.2 m each, in which people work by local civil time."""

    def __init__(self, seed: int, story: Story | None = None) -> None:
        self.seed = seed
        self.story = story or Story()
        self.standing = plan.standing()

    def occupancy(self, time: float) -> Cells:
        """Which cells are occupied at Unix seconds: bool of plan.SHAPE. About 0.3 ms."""
        now = moment(time)
        cells = self.standing.copy()
        self._doors(cells, time, now)
        taken = self._taken(time, now)
        for number, seat in enumerate(plan.SEATS):
            fill(cells, seat.person() if seat in taken else seat.chair(self._shift(number, now)))
        fill(cells, plan.PLANT_FIRST if time < self.story.plant_moves else plan.PLANT_LATER)
        return cells

    def states(self, time: float) -> dict[str, bool]:
        """The states of the locations that are no grid at Unix seconds."""
        now = moment(time)
        taken = self._taken(time, now)
        return {
            "main-door": self._main_door_open(time, now),
            "office-door": self._office_door_open(time, now),
            "office-occupied": not taken.isdisjoint(plan.OFFICE_SEATS),
            "lab-occupied": not taken.isdisjoint(plan.LAB_SEATS),
            "meeting-room": not taken.isdisjoint(plan.MEETING_SEATS),
        }

    def taken(self, time: float) -> frozenset[Seat]:
        """The seats on which somebody sits at Unix seconds."""
        return self._taken(time, moment(time))

    def _doors(self, cells: Cells, time: float, now: Moment) -> None:
        main, office = plan.MAIN_DOOR, plan.OFFICE_DOOR
        fill(cells, (main.open if self._main_door_open(time, now) else main.closed,))
        fill(cells, (office.open if self._office_door_open(time, now) else office.closed,))

    def _main_door_open(self, time: float, now: Moment) -> bool:
        """People come and go all day; on two evenings the cleaners leave it open."""
        cleaning = now.weekday in (TUESDAY, THURSDAY) and 19 <= now.hour < 20
        busy = now.workday and 7.5 <= now.hour < 18.5
        chance = 0.85 if cleaning else 0.6 if busy else 0.0
        return self._draw(_MAIN_DOOR, int(time // DOOR_SLOT_S)) < chance

    def _office_door_open(self, time: float, now: Moment) -> bool:
        """The first of the team to come opens it, the last to leave closes it."""
        start, stop = hours(OFFICE_TEAM, now.weekday, now.day, self.seed, _OFFICE)
        return start <= now.hour < stop or self.story.door_left_open(time)

    def _taken(self, time: float, now: Moment) -> frozenset[Seat]:
        taken = set()
        if not within(time, self.story.office_empty):
            taken |= self._team(OFFICE_TEAM, plan.OFFICE_SEATS, _OFFICE, now)
        taken |= self._team(LAB_TEAM, plan.LAB_SEATS, _LAB, now)
        n_guests = guests(now, len(plan.MEETING_SEATS), self.seed, _GUESTS)
        taken.update(plan.MEETING_SEATS[:n_guests])
        return frozenset(taken)

    def _team(self, team: tuple[Habits, ...], desks: tuple[Seat, ...], group: int, now: Moment) -> set[Seat]:
        taken = set()
        for person, (habits, desk) in enumerate(zip(team, desks, strict=True)):
            where = whereabouts(habits, now, self.seed, group, person)
            if where is Whereabouts.DESK:
                taken.add(desk)
            elif where is Whereabouts.KITCHEN and habits.eats_in is not None:
                taken.add(plan.KITCHEN_SEATS[habits.eats_in])
            elif where is Whereabouts.MEETING:
                taken.add(plan.MEETING_SEATS[2 * group + person])
        return taken

    def _shift(self, chair: int, now: Moment) -> int:
        """How far from its place an empty chair stands on a day, in cells: in a week each way once or twice."""
        if plan.SEATS[chair] not in plan.WANDERING_SEATS:
            return 0
        week, weekday = divmod(now.day, len(WEEK_OF_SHIFTS))
        return WEEK_OF_SHIFTS[(weekday * 3 + int(7 * self._draw(_CHAIR, chair, week))) % 7]

    def _draw(self, *key: int) -> float:
        return draw(self.seed, *key)
