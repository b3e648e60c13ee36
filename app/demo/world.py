"""The simulated building: a pure function of its seed and the time."""

from app.demo import plan
from app.demo.chance import draw
from app.demo.civil import THURSDAY, TUESDAY, Moment, moment
from app.demo.people import LAB_TEAM, OFFICE_TEAM, Habits, Place, guests, in_weekly_meeting, place
from app.demo.plan import Cells, Seat, fill
from app.demo.story import Story, within

_OFFICE, _LAB, _GUESTS, _CHAIR, _MAIN_DOOR, _OFFICE_DOOR = range(6)
DOOR_SLOT_S = 300.0


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
            shift = self._shift(number, now)
            fill(cells, seat.chair(shift))
            if seat in taken:
                fill(cells, seat.person(shift))
        fill(cells, plan.PLANT_FIRST if time < self.story.plant_moves else plan.PLANT_LATER)
        return cells

    def states(self, time: float) -> dict[str, bool]:
        """The states of the named places at Unix seconds."""
        now = moment(time)
        taken = self._taken(time, now)
        return {
            "main-door": self._main_door_open(time, now),
            "office-door": self._office_door_open(time, now),
            "office-occupied": not taken.isdisjoint(plan.OFFICE_SEATS),
            "lab-occupied": not taken.isdisjoint(plan.LAB_SEATS),
            "meeting-room": not taken.isdisjoint(plan.MEETING_SEATS),
        }

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
        if within(time, self.story.door_open):
            return True
        open_hours = now.workday and 8 <= now.hour < 17.5
        return self._draw(_OFFICE_DOOR, int(time // DOOR_SLOT_S)) < (0.93 if open_hours else 0.0)

    def _taken(self, time: float, now: Moment) -> frozenset[Seat]:
        """The seats on which somebody sits."""
        taken = set()
        if not within(time, self.story.office_empty):
            taken |= self._team(OFFICE_TEAM, plan.OFFICE_SEATS, _OFFICE, now)
        taken |= self._team(LAB_TEAM, plan.LAB_SEATS, _LAB, now)
        taken |= {plan.MEETING_SEATS[i] for i in guests(now, len(plan.MEETING_SEATS), self.seed, _GUESTS)}
        if in_weekly_meeting(now) and now.workday:
            taken |= set(plan.MEETING_SEATS[2:5])
        return frozenset(taken)

    def _team(self, team: tuple[Habits, ...], desks: tuple[Seat, ...], group: int, now: Moment) -> set[Seat]:
        taken = set()
        for person, (habits, desk) in enumerate(zip(team, desks, strict=True)):
            where = place(habits, now, self.seed, group, person)
            if where is Place.DESK:
                taken.add(desk)
            elif where is Place.KITCHEN and habits.eats_in is not None:
                taken.add(plan.KITCHEN_SEATS[habits.eats_in])
            elif where is Place.MEETING:
                taken.add(plan.MEETING_SEATS[2 * group + person])
        return taken

    def _shift(self, chair: int, now: Moment) -> int:
        """How far from its place the chair stands on a day, in cells."""
        chance = self._draw(_CHAIR, chair, now.day)
        return 0 if chance < 0.6 else -1 if chance < 0.8 else 1

    def _draw(self, *key: int) -> float:
        return draw(self.seed, *key)
