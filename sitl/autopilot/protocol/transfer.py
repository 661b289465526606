"""Mission transfer: upload, download and clearing of the vehicle's three lists.

The MAVLink mission protocol from the vehicle's side. It asks for every item itself and asks
again when none comes, so it survives loss, duplication and reordering; a list is replaced only
once the new one is complete. Where messages are seen to get lost, answers are echoed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sitl.autopilot.protocol.echo import Echoes
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import MissionResult, MissionType, Severity

# MAVSDK counts one of its five tries for every 0.5 s without a request: ask more than twice in that
# time, but not so often that requests overtake the answers of a slow link.
REQUEST_AGAIN_S = 0.2
REQUESTS_PER_ITEM = 16
_OLD_AFTER = 6  # requests without any answer
DOWNLOAD_KEPT_S = 10.0
MAX_ITEMS = 5000

_OURS = (
    m.MissionCount,
    m.MissionItem,
    m.MissionRequestList,
    m.MissionRequest,
    m.MissionClearAll,
    m.MissionAck,
    m.MissionPartialList,
)

Check = Callable[[m.MissionItem], MissionResult]
Store = Callable[[MissionType, tuple[m.MissionItem, ...]], MissionResult]


@dataclass(slots=True)
class _Upload:
    peer: m.Peer
    kind: MissionType
    count: int
    deadline: float
    asked: int = 1
    items: list[m.MissionItem] = field(default_factory=list)
    lossy: bool = False  # something had to be asked for again
    old: bool = False  # asked for by the old message


@dataclass(frozen=True, slots=True)
class _Completed:
    peer: m.Peer
    kind: MissionType
    count: int
    at: float


@dataclass(slots=True)
class _Download:
    items: tuple[m.MissionItem, ...]
    until: float
    asked: int | None = None  # the item asked for last
    lossy: bool = False  # something was asked for again


class MissionTransfer:
    """Serves the mission protocol; holds the lists that were accepted.

    `check` judges each item as it comes; `store` judges the complete list and takes it.
    """

    def __init__(self, outbox: m.Outbox, *, check: Check, store: Store) -> None:
        self._outbox = outbox
        self._check = check
        self._store = store
        self._lists: dict[MissionType, tuple[m.MissionItem, ...]] = {
            kind: () for kind in MissionType if kind is not MissionType.ALL
        }
        self._upload: _Upload | None = None
        self._downloads: dict[tuple[m.Peer, MissionType], _Download] = {}
        self._completed: _Completed | None = None
        self._echoes = Echoes(outbox)

    @property
    def lists(self) -> Mapping[MissionType, tuple[m.MissionItem, ...]]:
        """What was accepted last, by kind."""
        return self._lists

    def restore(self, lists: Mapping[MissionType, tuple[m.MissionItem, ...]]) -> None:
        """Take lists that were accepted before."""
        for kind, items in lists.items():
            self._take(kind, items)

    def receive(self, peer: m.Peer, message: m.Incoming, now: float) -> bool:
        """Handle a message of the mission protocol; False for one that is none."""
        if not isinstance(message, _OURS):
            return False
        self._echoes.heard(peer)
        match message:
            case m.MissionCount():
                self._count(peer, message, now)
            case m.MissionItem():
                self._item(peer, message, now)
            case m.MissionRequestList():
                self._list(peer, message, now)
            case m.MissionRequest():
                self._request(peer, message, now)
            case m.MissionClearAll():
                self._clear(peer, message)
            case m.MissionAck():
                self._downloads.pop((peer, message.mission_type), None)
            case m.MissionPartialList():
                self._refuse_partial(peer, message)
        return True

    def give_up(self, peer: m.Peer, message: m.Incoming) -> None:
        """Handling `message` has failed: its transfer is over, and whoever sent it is told so."""
        if isinstance(message, m.MissionItem | m.MissionCount) and self._upload is not None:
            self._upload = None if self._upload.peer == peer else self._upload
        if isinstance(message, _OURS) and not isinstance(message, m.MissionAck):
            self._ack(peer, message.mission_type, MissionResult.ERROR)

    def poll(self, now: float) -> None:
        """Ask again for an item that has not come; give up in the end."""
        upload = self._upload
        if upload is not None and now >= upload.deadline:
            if upload.asked >= REQUESTS_PER_ITEM:
                self._finish(upload, MissionResult.OPERATION_CANCELLED)
            else:
                upload.asked += 1
                upload.lossy = True
                self._ask(upload, now)
        self._echoes.poll(now)
        for key, download in list(self._downloads.items()):
            if now >= download.until:
                del self._downloads[key]

    def due(self) -> float | None:
        """When `poll` has something to do; None for never."""
        timers = (None if self._upload is None else self._upload.deadline, self._echoes.due())
        return min((timer for timer in timers if timer is not None), default=None)

    def _count(self, peer: m.Peer, message: m.MissionCount, now: float) -> None:
        kind = message.mission_type
        busy = self._upload is not None and self._upload.peer != peer
        if kind not in self._lists:
            self._ack(peer, kind, MissionResult.UNSUPPORTED)
        elif busy:
            self._ack(peer, kind, MissionResult.DENIED)
        elif message.count > MAX_ITEMS:
            self._upload = None
            self._ack(peer, kind, MissionResult.NO_SPACE)
        elif message.count == 0:
            self._upload = None
            self._ack(peer, kind, self._take(kind, ()))
        else:
            # Always from the first item: the same count may announce another list.
            self._completed = None
            self._upload = _Upload(peer, kind, message.count, now)
            self._ask(self._upload, now)

    def _item(self, peer: m.Peer, item: m.MissionItem, now: float) -> None:
        upload = self._upload
        if upload is None or (upload.peer, upload.kind) != (peer, item.mission_type):
            self._thank_again(peer, item, now)
            return
        if item.seq != len(upload.items):
            return  # a duplicate, or overtaken by another; what is missing is asked for again
        verdict = self._check(item)
        if verdict is not MissionResult.ACCEPTED:
            self._finish(upload, verdict)
            return
        upload.items.append(item)
        if len(upload.items) < upload.count:
            upload.asked = 1
            self._ask(upload, now)
            return
        verdict = self._take(upload.kind, tuple(upload.items))
        self._finish(upload, verdict)
        if upload.lossy:
            self._echoes.repeat(peer, m.MissionAck(verdict, upload.kind), now)
        if verdict is MissionResult.ACCEPTED:
            self._completed = _Completed(peer, upload.kind, upload.count, now)

    def _thank_again(self, peer: m.Peer, item: m.MissionItem, now: float) -> None:
        """Still sending items of a complete upload: our acknowledgement was lost.

        Not at once: that would be a duplicate on its way, and a second acknowledgement might
        meet the next upload.
        """
        done = self._completed
        if done is None or (done.peer, done.kind) != (peer, item.mission_type):
            return
        if item.seq < done.count and now - done.at >= REQUEST_AGAIN_S:
            self._ack(peer, item.mission_type, MissionResult.ACCEPTED)

    def _list(self, peer: m.Peer, message: m.MissionRequestList, now: float) -> None:
        items = self._lists.get(message.mission_type)
        if items is None:
            self._ack(peer, message.mission_type, MissionResult.UNSUPPORTED)
            return
        # What was announced is what will be sent, even if somebody replaces the list meanwhile.
        self._downloads[peer, message.mission_type] = _Download(items, now + DOWNLOAD_KEPT_S)
        self._send(peer, m.MissionCount(len(items), message.mission_type))

    def _request(self, peer: m.Peer, message: m.MissionRequest, now: float) -> None:
        download = self._downloads.get((peer, message.mission_type))
        if download is not None:
            download.until = now + DOWNLOAD_KEPT_S
            items = download.items
        else:
            items = self._lists.get(message.mission_type, ())
        if message.seq >= len(items):
            self._ack(peer, message.mission_type, MissionResult.INVALID_SEQUENCE)
            return
        self._send(peer, items[message.seq])
        if download is not None:
            download.lossy = download.lossy or message.seq == download.asked
            download.asked = message.seq
            if download.lossy:
                self._echoes.repeat(peer, items[message.seq], now)

    def _clear(self, peer: m.Peer, message: m.MissionClearAll) -> None:
        every = message.mission_type is MissionType.ALL
        kinds = tuple(self._lists) if every else (message.mission_type,)
        verdicts = [self._take(kind, ()) for kind in kinds]
        refused = [v for v in verdicts if v is not MissionResult.ACCEPTED]
        self._ack(peer, message.mission_type, refused[0] if refused else MissionResult.ACCEPTED)

    def _refuse_partial(self, peer: m.Peer, message: m.MissionPartialList) -> None:
        self._ack(peer, message.mission_type, MissionResult.UNSUPPORTED)
        text = "Partial mission lists are not supported: transfer the whole list"
        self._outbox.append(m.Envelope(m.StatusText(Severity.WARNING, text)))

    def _take(self, kind: MissionType, items: tuple[m.MissionItem, ...]) -> MissionResult:
        verdict = self._store(kind, items)
        if verdict is MissionResult.ACCEPTED:
            self._lists[kind] = items
        return verdict

    def _ask(self, upload: _Upload, now: float) -> None:
        upload.deadline = now + REQUEST_AGAIN_S
        # Who has not answered once may know the old message only (dronekit); MAVSDK knows the new
        # one only, and ends an upload by the old one.
        if not upload.items:
            upload.old = upload.asked > _OLD_AFTER and upload.asked % 2 == 1
        self._send(upload.peer, m.MissionRequest(len(upload.items), upload.kind, upload.old))

    def _finish(self, upload: _Upload, result: MissionResult) -> None:
        self._upload = None
        self._ack(upload.peer, upload.kind, result)

    def _ack(self, peer: m.Peer, kind: MissionType, result: MissionResult) -> None:
        self._send(peer, m.MissionAck(result, kind))

    def _send(self, peer: m.Peer, body: m.Outgoing) -> None:
        self._outbox.append(m.Envelope(body, peer))
