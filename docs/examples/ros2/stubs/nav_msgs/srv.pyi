from nav_msgs.msg import OccupancyGrid

class GetMap:
    class Request: ...

    class Response:
        map: OccupancyGrid
