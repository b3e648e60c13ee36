"""Jobs as the API shows them."""

from tidemap.schemas.jobs import Job
from tidemap.storage.records import JobRecord


def job_view(record: JobRecord) -> Job:
    """A job."""
    return Job(**{name: getattr(record, name) for name in Job.model_fields})
