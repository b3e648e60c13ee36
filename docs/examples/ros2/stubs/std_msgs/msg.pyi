from builtin_interfaces.msg import Time

class Header:
    stamp: Time
    frame_id: str

class Bool:
    data: bool
    def __init__(self) -> None: ...
