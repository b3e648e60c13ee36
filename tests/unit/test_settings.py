"""The settings of a server."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import make_url

from tidemap.settings import Settings


@given(name=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1))
def test_the_database_is_in_the_data_folder_whatever_that_is_called(name: str) -> None:
    url = make_url(Settings(data=Path(name), database_url=None).url)
    assert url.database is not None
    assert Path(url.database) == Path(name) / "tidemap.db"
    assert (url.get_backend_name(), url.host, dict(url.query)) == ("sqlite", None, {})
