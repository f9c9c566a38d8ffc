"""What all that is done in sessions shares: the sessions, their desks, and who works for them."""

from __future__ import annotations

from pathlib import Path

from pinholify.errors import InputError
from pinholify.web.desk import Desk, photograph_event, session_event
from pinholify.web.limits import Limits
from pinholify.web.sessions import Photograph, Session, Store
from pinholify.web.work import Crew


class NotThere(InputError):
    """What was asked for does not exist, or no longer."""


class Workroom:
    """The sessions in a ``store``, within ``limits``, and the processes of a ``crew`` that work for them."""

    def __init__(self, store: Store, crew: Crew, limits: Limits) -> None:
        """No session is open yet."""
        self.store = store
        self.crew = crew
        self.limits = limits
        self.desks: dict[str, Desk] = {}

    def session(self, session_id: str) -> Session:
        """The session of that id; raises NotThere."""
        session = self.store.get(session_id)
        if session is None:
            raise NotThere("there is no such session; it may have been deleted")
        return session

    def desk(self, session_id: str) -> Desk:
        """The desk of a session."""
        return self.desks.setdefault(session_id, Desk(session_id))

    def photograph(self, session_id: str, photograph_id: str) -> Photograph:
        """A photograph of a session; raises NotThere."""
        photograph = self.session(session_id).photograph(photograph_id)
        if photograph is None:
            raise NotThere("there is no such photograph; it may have been removed")
        return photograph

    def original(self, session_id: str, photograph_id: str) -> Path:
        """The file of a photograph as it was sent."""
        return self.store.path(session_id, photograph_id, "original")

    def put(self, session: Session) -> None:
        """Keep a changed ``session`` and tell open pages."""
        self.store.put(session)
        desk = self.desk(session.id)
        desk.tell("session", session=session_event(session))

    def put_photograph(self, session_id: str, photograph: Photograph) -> None:
        """Keep a new or changed ``photograph`` and tell open pages."""
        session = self.session(session_id).with_photograph(photograph)
        self.store.put_photograph(session, photograph)
        self.desk(session_id).tell("photograph", photograph=photograph_event(photograph))
        self.put(session)

    def forget(self, *paths: Path) -> None:
        """Remove what has not become a part of a session."""
        for path in paths:
            self.store.remove(path.parent.name, path.name)
