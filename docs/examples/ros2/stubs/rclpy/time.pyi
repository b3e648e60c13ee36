from builtin_interfaces import msg

class Time:
    @property
    def nanoseconds(self) -> int: ...
    @classmethod
    def from_msg(cls, msg: msg.Time) -> Time: ...
