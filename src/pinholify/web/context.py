"""What all parts of the app share: the stored sessions, their live states, and the process pool."""

from __future__ import annotations

from pathlib import Path

from pinholify.errors import InputError
from pinholify.web.limits import Limits
from pinholify.web.process_pool import ProcessPool
from pinholify.web.session_state import SessionState, photograph_event, session_event
from pinholify.web.sessions import Photograph, Session, Store


class NotFound(InputError):
    """The requested session, photograph or file does not exist, or no longer exists."""


class AppContext:
    """The sessions of a ``store``, the ``limits`` on them, and the ``pool`` for long work."""

    def __init__(self, store: Store, pool: ProcessPool, limits: Limits) -> None:
        """Opens no session yet."""
        self.store = store
        self.pool = pool
        self.limits = limits
        self.states: dict[str, SessionState] = {}

    def session(self, session_id: str) -> Session:
        """The session with that id; raises NotFound."""
        session = self.store.get(session_id)
        if session is None:
            raise NotFound("there is no such session; it may have been deleted")
        return session

    def state(self, session_id: str) -> SessionState:
        """The live state of a session."""
        return self.states.setdefault(session_id, SessionState(session_id))

    def photograph(self, session_id: str, photograph_id: str) -> Photograph:
        """A photograph of a session; raises NotFound."""
        photograph = self.session(session_id).photograph(photograph_id)
        if photograph is None:
            raise NotFound("there is no such photograph; it may have been removed")
        return photograph

    def original(self, session_id: str, photograph_id: str) -> Path:
        """The file of a photograph as it was uploaded."""
        return self.store.path(session_id, photograph_id, "original")

    def put(self, session: Session) -> None:
        """Store a changed ``session`` and update open pages."""
        self.store.put(session)
        self.state(session.id).publish("session", session=session_event(session))

    def put_photograph(self, session_id: str, photograph: Photograph) -> None:
        """Store a new or changed ``photograph`` and update open pages."""
        session = self.session(session_id).with_photograph(photograph)
        self.store.put_photograph(session, photograph)
        self.state(session_id).publish("photograph", photograph=photograph_event(photograph))
        self.put(session)

    def discard(self, *paths: Path) -> None:
        """Remove files or folders that have not become part of a session."""
        for path in paths:
            self.store.remove(path.parent.name, path.name)
