"""What became of a post, as the API shows it."""

from tidemap.api.views.anomalies import event_view
from tidemap.schemas.observations import Accepted
from tidemap.services.listing import most_surprising
from tidemap.services.posts import Observed


def accepted_view(result: Observed) -> Accepted:
    """The answer to a post."""
    return Accepted(
        accepted=result.accepted,
        dropped=result.dropped,
        duplicate=result.duplicate,
        first_time=result.first_time,
        last_time=result.last_time,
        anomalies=[event_view(event) for event in most_surprising(result.anomalies)],
        anomalies_total=len(result.anomalies),
        revision=result.revision,
    )
