class Time:
    sec: int
    nanosec: int
