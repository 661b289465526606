"""The attack on the autopilot for as long as wanted; a failure prints the seed that replays it.

    python benchmarks/fuzz.py --frames 1e6            handed over in this process, tick by tick
    python benchmarks/fuzz.py --udp-frames 1e5        over UDP, while simulated time runs
    python benchmarks/fuzz.py --seed 17 --frames 2000 one attack again
    python benchmarks/fuzz.py --atheris 600           the codec under libFuzzer, if atheris is there

Each attack is 2,000 frames on a fresh vehicle, and a mission afterwards.
"""

import argparse
import asyncio
import resource
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.flying.modes import Mode
from sitl.links import UdpLink
from sitl.pace import Simulation

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / name) for name in ("sitl", ".")]
from sitl_desk import Desk  # noqa: E402
from sitl_fuzz import Attack, BrokenError, Frames  # noqa: E402

PER_ATTACK = 2000
PROGRESS_EVERY = 50_000
PER_UDP_ATTACK = 5000


def in_process(frames: int, *, seed: int) -> None:
    """Attack after attack."""
    began, sent, slowest = time.perf_counter(), 0, 0.0
    while sent < frames:
        attack = Attack(seed)
        receive = attack.desk.vehicle.receive

        def timed(data: bytes, now: float, receive=receive) -> None:  # type: ignore[no-untyped-def]
            nonlocal slowest
            at = time.perf_counter()
            receive(data, now)
            slowest = max(slowest, time.perf_counter() - at)

        attack.desk.vehicle.receive = timed  # type: ignore[method-assign, assignment]
        attack.run(min(PER_ATTACK, frames - sent))
        sent += attack.sent
        seed += 1
        if sent % PROGRESS_EVERY < PER_ATTACK:
            _tell(sent, seed, slowest, time.perf_counter() - began)
    _tell(sent, seed, slowest, time.perf_counter() - began)


def _tell(sent: int, seed: int, slowest_s: float, took_s: float) -> None:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(
        f"{sent} frames in {took_s:.0f} s ({time.process_time():.0f} s of a processor), next seed "
        f"{seed}; no oracle broken; the slowest was handled in {slowest_s * 1e3:.0f} ms; peak "
        f"memory {peak} MiB",
        flush=True,
    )


async def over_udp(frames: int, *, seed: int) -> None:
    """Attack after attack through a socket, with a heartbeat after each."""
    began, heard, ended = time.perf_counter(), 0, 0
    for first in range(0, frames, PER_UDP_ATTACK):
        count = min(PER_UDP_ATTACK, frames - first)
        back, terminated = await _attack_over_udp(count, seed=seed)
        heard, ended, seed = heard + back, ended + terminated, seed + 1
    print(
        f"{frames} frames over UDP in {time.perf_counter() - began:.0f} s, next seed {seed}; "
        f"{heard} datagrams back; a heartbeat after each {PER_UDP_ATTACK} frames; {ended} flights "
        "were terminated by order",
        flush=True,
    )


async def _attack_over_udp(frames: int, *, seed: int) -> tuple[int, bool]:
    desk, drawn, heard, arrived = Desk(), Frames(seed), 0, 0
    receive = desk.vehicle.receive

    def counted(datagram: bytes, now: float) -> None:
        nonlocal arrived
        arrived += 1
        receive(datagram, now)

    desk.vehicle.receive = counted  # type: ignore[method-assign]
    link, loop = UdpLink("udpin://127.0.0.1:0"), asyncio.get_running_loop()
    async with Simulation(desk.vehicle, link, speed=20.0, runs="always"):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.setblocking(False)
            station.connect(("127.0.0.1", link.port))
            for number in range(frames):
                await loop.sock_sendall(station, drawn.draw())
                heard += _drained(station)
                while number - arrived > 100:  # noqa: ASYNC110  # or the system's buffer runs over
                    await asyncio.sleep(0.001)
            alive = False
            while not alive:
                try:
                    data = await asyncio.wait_for(loop.sock_recv(station, 4096), 30.0)
                except TimeoutError:
                    raise BrokenError(f"seed {seed}: silent after {frames} frames") from None
                ears = mav.MAVLink(None)
                ears.robust_parsing = True
                alive = any(m.get_type() == "HEARTBEAT" for m in ears.parse_buffer(data) or ())
    return heard, desk.vehicle.autopilot.mode is Mode.TERMINATED


def _drained(station: socket.socket) -> int:
    """Datagrams that had arrived."""
    count = 0
    while True:
        try:
            station.recv(4096)
            count += 1
        except (BlockingIOError, ConnectionError):
            return count


# In a process of its own: only what is imported under its eyes is followed by libFuzzer.
UNDER_ATHERIS = """
import sys
import atheris
with atheris.instrument_imports(include=["sitl.autopilot.codec"]):
    from sitl.autopilot.codec import orders
    from sitl.autopilot.codec.wire import Seal, Wire
wire, seal = Wire(1, 1), Seal(bytes(32), link_id=1, clock=lambda: 1.5e9)

def once(data):
    for message in wire.read(data):
        if message.get_type().startswith("COMMAND_") and hasattr(message, "param1"):
            orders.read_order(message)
        elif message.get_type().startswith("MISSION_ITEM") and hasattr(message, "param1"):
            orders.read_item(message)
    seal.opened(data)

atheris.Setup(sys.argv, once)
atheris.Fuzz()
"""


def under_atheris(seconds: int) -> None:
    """The codec: bytes in, values out; and the seal of signed links."""
    with tempfile.TemporaryDirectory() as corpus:
        for number, frame in zip(range(600), Frames(0), strict=False):
            (Path(corpus) / f"{number:04}").write_bytes(frame)
        limits = (f"-max_total_time={seconds}", "-max_len=600", "-print_final_stats=1")
        subprocess.run([sys.executable, "-c", UNDER_ATHERIS, *limits, corpus], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=float, default=0)
    parser.add_argument("--udp-frames", type=float, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--atheris", type=int, metavar="SECONDS", default=0)
    given = parser.parse_args()
    if given.frames:
        in_process(int(given.frames), seed=given.seed)
    if given.udp_frames:
        asyncio.run(over_udp(int(given.udp_frames), seed=given.seed))
    if given.atheris:
        under_atheris(given.atheris)


if __name__ == "__main__":
    main()
