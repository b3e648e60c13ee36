from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.impl import RcutilsLogger
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

M = TypeVar("M")
Q = TypeVar("Q")
A = TypeVar("A")

class Node:
    def __init__(self, node_name: str) -> None: ...
    def declare_parameter(self, name: str, value: str | float) -> Parameter: ...
    def get_clock(self) -> Clock: ...
    def get_logger(self) -> RcutilsLogger: ...
    def create_publisher(self, msg_type: type[M], topic: str, qos_profile: QoSProfile | int) -> Publisher[M]: ...
    def create_subscription(
        self,
        msg_type: type[M],
        topic: str,
        callback: Callable[[M], None],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
    ) -> Subscription: ...
    def destroy_subscription(self, subscription: Subscription) -> bool: ...
    def create_client(self, srv_type: type[Any], srv_name: str) -> Client: ...
    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], None],
        callback_group: CallbackGroup | None = None,
    ) -> object: ...
    def create_service(self, srv_type: type[Any], srv_name: str, callback: Callable[[Q, A], A]) -> object: ...
    def destroy_node(self) -> None: ...
