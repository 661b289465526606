"""Mission transfer: upload, download and clearing of the vehicle's three lists.

The MAVLink mission protocol from the vehicle's side. It asks for every item itself and asks
again when none comes, so it survives loss, duplication and reordering; a list is replaced only
once the new one is complete. On a lossy link, answers are repeated unasked: a ground station
retries a few times before it gives up, and repeated answers leave its retries for the case that
the request was lost.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Handlers, MissionItem, Outbox, Peer, read_item
from sitl.autopilot.reporter import Reporter

# MAVSDK counts one of its five tries for every 0.5 s without a request: ask more than twice in that
# time, but not so often that requests overtake the answers of a slow link.
REQUEST_AGAIN_S = 0.2
REQUESTS_PER_ITEM = 16
_OLD_AFTER = 6  # requests without any answer
DOWNLOAD_KEPT_S = 10.0
MAX_ITEMS = 5000
ANSWERS_REPEATED = 3
_REPEAT_S = 0.1  # below every ground station's time-out

MISSION, FENCE, RALLY, ALL = (
    mav.MAV_MISSION_TYPE_MISSION,
    mav.MAV_MISSION_TYPE_FENCE,
    mav.MAV_MISSION_TYPE_RALLY,
    mav.MAV_MISSION_TYPE_ALL,
)
Lists = Mapping[int, tuple[MissionItem, ...]]  # by MAV_MISSION_TYPE
Check = Callable[[MissionItem], int]
Store = Callable[[int, tuple[MissionItem, ...]], int]


@dataclass(slots=True)
class _Upload:
    peer: Peer
    kind: int
    count: int
    asked_at: float  # wall time (s) of the last request; of a complete one, of its end
    asked: int = 1  # times, for the same item
    items: list[MissionItem] = field(default_factory=list)
    lossy: bool = False  # something had to be asked for again
    old: bool = False  # asked for by the old message


@dataclass(slots=True)
class _Download:
    items: tuple[MissionItem, ...]
    until: float
    asked: int | None = None  # the item asked for last
    lossy: bool = False  # something was asked for again


@dataclass(slots=True)
class _Repeated:
    answer: mav.MAVLink_message
    due: float
    left: int = ANSWERS_REPEATED


class MissionTransfer:
    """Serves the mission protocol; holds the lists that were accepted.

    `check` validates each item on arrival, `store` checks and takes the complete list; both return
    a MAV_MISSION_RESULT.
    """

    def __init__(self, outbox: Outbox, reporter: Reporter, *, check: Check, store: Store) -> None:
        self._outbox = outbox
        self._report = reporter
        self._check = check
        self._store = store
        # The lists that were accepted last.
        self.lists: dict[int, tuple[MissionItem, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self._upload: _Upload | None = None
        self._downloads: dict[tuple[Peer, int], _Download] = {}
        self._completed: _Upload | None = None
        self._repeated: dict[Peer, _Repeated] = {}  # the newest answer to each, on a bad link
        self._by_type: Handlers = {
            mav.MAVLink_mission_count_message: self._count,
            mav.MAVLink_mission_item_message: self._item,
            mav.MAVLink_mission_item_int_message: self._item,
            mav.MAVLink_mission_request_list_message: self._list,
            mav.MAVLink_mission_request_message: self._request,
            mav.MAVLink_mission_request_int_message: self._request,
            mav.MAVLink_mission_clear_all_message: self._clear,
            mav.MAVLink_mission_ack_message: self._end,
            mav.MAVLink_mission_request_partial_list_message: self._refuse_partial,
            mav.MAVLink_mission_write_partial_list_message: self._refuse_partial,
        }
        self.handlers: Handlers = dict.fromkeys(self._by_type, self._handle)

    def restore(self, lists: Lists) -> None:
        """Take lists that were accepted before."""
        for kind, items in lists.items():
            self._take(kind, items)

    def _handle(self, peer: Peer, msg: Any, now: float) -> None:
        """Handle a message; one about an unknown list is refused."""
        # Whatever the peer waits for now, it is not the answer before.
        self._repeated.pop(peer, None)
        cleared = isinstance(msg, mav.MAVLink_mission_clear_all_message)
        if msg.mission_type in self.lists or (cleared and msg.mission_type == ALL):
            self._by_type[type(msg)](peer, msg, now)
        elif not isinstance(msg, mav.MAVLink_mission_ack_message):
            self._ack(peer, msg.mission_type, mav.MAV_MISSION_UNSUPPORTED)

    def give_up(self, peer: Peer, msg: Any) -> None:
        """End the upload of a peer whose `msg` could not be handled, and answer with an error."""
        if self._upload is not None and self._upload.peer == peer:
            self._upload = None
        if not isinstance(msg, mav.MAVLink_mission_ack_message):
            self._ack(peer, msg.mission_type, mav.MAV_MISSION_ERROR)

    def poll(self, now: float) -> None:
        """Request a missing item again, or give up; repeat answers; forget old downloads."""
        upload = self._upload
        if upload is not None and now >= upload.asked_at + REQUEST_AGAIN_S:
            if upload.asked >= REQUESTS_PER_ITEM:
                self._finish(upload, mav.MAV_MISSION_OPERATION_CANCELLED)
            else:
                upload.asked += 1
                upload.lossy = True
                self._ask(upload, now)
        for peer, repeated in list(self._repeated.items()):
            if now >= repeated.due:
                self._outbox.append(repeated.answer, peer)
                repeated.due, repeated.left = now + _REPEAT_S, repeated.left - 1
                if repeated.left == 0:
                    del self._repeated[peer]
        for key, download in list(self._downloads.items()):
            if now >= download.until:
                del self._downloads[key]

    def due(self) -> float:
        """Return the time (s) at which `poll` has something to send; infinite for never."""
        upload = math.inf if self._upload is None else self._upload.asked_at + REQUEST_AGAIN_S
        return min([upload, *(repeated.due for repeated in self._repeated.values())])

    def _count(self, peer: Peer, msg: mav.MAVLink_mission_count_message, now: float) -> None:
        kind = msg.mission_type
        if self._upload is not None and self._upload.peer != peer:
            self._ack(peer, kind, mav.MAV_MISSION_DENIED)
        elif msg.count > MAX_ITEMS:
            self._upload = None
            self._ack(peer, kind, mav.MAV_MISSION_NO_SPACE)
        elif msg.count == 0:
            self._upload = None
            self._ack(peer, kind, self._take(kind, ()))
        else:
            # Always from the first item: the same count may announce another list.
            self._completed = None
            self._upload = _Upload(peer, kind, msg.count, now)
            self._ask(self._upload, now)

    def _item(
        self,
        peer: Peer,
        msg: mav.MAVLink_mission_item_message | mav.MAVLink_mission_item_int_message,
        now: float,
    ) -> None:
        upload, item = self._upload, read_item(msg)
        if upload is None or (upload.peer, upload.kind) != (peer, item.mission_type):
            self._acknowledge_again(peer, item, now)
            return
        if item.seq != len(upload.items):
            return  # a duplicate, or overtaken by another; what is missing is asked for again
        verdict = self._check(item)
        if verdict != mav.MAV_MISSION_ACCEPTED:
            self._finish(upload, verdict)
            return
        upload.items.append(item)
        if len(upload.items) < upload.count:
            upload.asked = 1
            self._ask(upload, now)
            return
        verdict = self._take(upload.kind, tuple(upload.items))
        answer = self._finish(upload, verdict)
        if upload.lossy:
            self._repeated[peer] = _Repeated(answer, now + _REPEAT_S)
        if verdict == mav.MAV_MISSION_ACCEPTED:
            self._completed, upload.asked_at = upload, now

    def _acknowledge_again(self, peer: Peer, item: MissionItem, now: float) -> None:
        """Acknowledge again an upload that is complete and still sent: the first answer was lost.

        Not at once: that would be a duplicate on its way, and a second acknowledgement might
        meet the next upload.
        """
        done = self._completed
        if done is None or (done.peer, done.kind) != (peer, item.mission_type):
            return
        if item.seq < done.count and now - done.asked_at >= REQUEST_AGAIN_S:
            self._ack(peer, item.mission_type, mav.MAV_MISSION_ACCEPTED)

    def _list(self, peer: Peer, msg: mav.MAVLink_mission_request_list_message, now: float) -> None:
        kind = msg.mission_type
        items = self.lists[kind]
        # What was announced is what will be sent, even if somebody replaces the list meanwhile.
        self._downloads[peer, kind] = _Download(items, now + DOWNLOAD_KEPT_S)
        self._outbox.append(mav.MAVLink_mission_count_message(*peer.ids, len(items), kind), peer)

    def _request(
        self,
        peer: Peer,
        msg: mav.MAVLink_mission_request_message | mav.MAVLink_mission_request_int_message,
        now: float,
    ) -> None:
        download = self._downloads.get((peer, msg.mission_type))
        if download is not None:
            download.until = now + DOWNLOAD_KEPT_S
            items = download.items
        else:
            items = self.lists[msg.mission_type]
        if msg.seq >= len(items):
            self._ack(peer, msg.mission_type, mav.MAV_MISSION_INVALID_SEQUENCE)
            return
        old = isinstance(msg, mav.MAVLink_mission_request_message)
        answer = items[msg.seq].message(peer, old=old)
        self._outbox.append(answer, peer)
        if download is not None:
            download.lossy = download.lossy or msg.seq == download.asked
            download.asked = msg.seq
            if download.lossy:
                self._repeated[peer] = _Repeated(answer, now + _REPEAT_S)

    def _end(self, peer: Peer, msg: mav.MAVLink_mission_ack_message, _now: float) -> None:
        """A download is over; so is an upload that its station breaks off."""
        key, upload = (peer, msg.mission_type), self._upload
        self._downloads.pop(key, None)
        broken_off = msg.type != mav.MAV_MISSION_ACCEPTED
        if broken_off and upload is not None and (upload.peer, upload.kind) == key:
            self._upload = None

    def _clear(self, peer: Peer, msg: mav.MAVLink_mission_clear_all_message, _now: float) -> None:
        kinds = tuple(self.lists) if msg.mission_type == ALL else (msg.mission_type,)
        verdicts = [self._take(kind, ()) for kind in kinds]
        refused = [verdict for verdict in verdicts if verdict != mav.MAV_MISSION_ACCEPTED]
        self._ack(peer, msg.mission_type, refused[0] if refused else mav.MAV_MISSION_ACCEPTED)

    def _refuse_partial(self, peer: Peer, msg: Any, _now: float) -> None:
        self._ack(peer, msg.mission_type, mav.MAV_MISSION_UNSUPPORTED)
        text = "Partial mission lists are not supported: transfer the whole list"
        self._report.say(text)

    def _take(self, kind: int, items: tuple[MissionItem, ...]) -> int:
        verdict = self._store(kind, items)
        if verdict == mav.MAV_MISSION_ACCEPTED:
            self.lists[kind] = items
        return verdict

    def _ask(self, upload: _Upload, now: float) -> None:
        upload.asked_at = now
        # Who has not answered once may know the old message only (dronekit); MAVSDK knows the new
        # one only, and ends an upload by the old one.
        if not upload.items:
            upload.old = upload.asked > _OLD_AFTER and upload.asked % 2 == 1
        make = (
            mav.MAVLink_mission_request_message
            if upload.old
            else mav.MAVLink_mission_request_int_message
        )
        peer = upload.peer
        self._outbox.append(make(*peer.ids, len(upload.items), upload.kind), peer)

    def _finish(self, upload: _Upload, result: int) -> mav.MAVLink_message:
        self._upload = None
        return self._ack(upload.peer, upload.kind, result)

    def _ack(self, peer: Peer, kind: int, result: int) -> mav.MAVLink_message:
        ack = mav.MAVLink_mission_ack_message(*peer.ids, result, kind)
        self._outbox.append(ack, peer)
        return ack
