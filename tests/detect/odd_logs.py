"""Over two hundred kinds of odd log, each the same small drive with one thing wrong, made from a few families."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from small_logs import CAMERA, COMPRESSED, LEFT, RIGHT, T0_NS, blank, drive, jpeg

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.target.arrays import Array, Ids

STAND, MOVE, STOPS = 2.0, 1.5, 6
PERIOD = STAND + MOVE
IMAGE_STOPS = range(STOPS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What a log holds, to be spoilt: joint readings and pictures, each with its stamps and times of recording.

    Attributes
    ----------
    t_ns, log_ns, phi
        Of the joint messages: stamps, times of recording, angles (S, 2), right and left.
    velocity
        Speeds (S, 2), None for none.
    names
        Of the joints.
    pictures
        Stamp, time of recording, encoded picture or raw array, topic.
    extra
        Writes further messages.
    spoil
        Spoils the finished file's bytes.
    writer
        Options of the writer.
    """

    t_ns: Ids
    log_ns: Ids
    phi: Array
    velocity: Array | None = None
    names: tuple[str, ...] = (RIGHT, LEFT)
    topic: str = "/joint_states"
    pictures: tuple[tuple[int, int, Any, str], ...] = ()
    extra: Callable[[LogWriter], None] | None = None
    spoil: Callable[[bytes], bytes] | None = None
    writer: dict[str, Any] = field(default_factory=dict)


def sound(rate_hz: float = 50.0) -> Drive:
    """The sound drive."""
    t_ns, phi_R, phi_L, _ = drive(stops=STOPS, stand=STAND, move=MOVE, rate_hz=rate_hz)
    pictures = []
    for k in IMAGE_STOPS:
        for within in (0.6, 1.0, 1.4):
            t = T0_NS + round((k * PERIOD + within) * 1e9)
            pictures.append((t, t + 30_000_000, blank(48, 64) + np.uint8(10 * k), CAMERA))
    return Drive(t_ns=t_ns, log_ns=t_ns + 2_000_000, phi=np.stack([phi_R, phi_L], axis=1), pictures=tuple(pictures))


def write(path: Path, made: Drive) -> Path:
    """Write a log by times of recording."""
    events: list[tuple[int, int, int]] = [(int(t), 0, k) for k, t in enumerate(made.log_ns)]
    events += [(log, 1, k) for k, (_, log, _, _) in enumerate(made.pictures)]
    with LogWriter(path, **{"chunk_bytes": 1 << 14, **made.writer}) as log_file:
        for log, kind, k in sorted(events):
            if kind == 0:
                row = made.phi[k]
                speeds = () if made.velocity is None else made.velocity[k]
                known = np.ones(len(row), dtype=bool) if made.velocity is not None else ~np.isneginf(row)
                names = [n for n, keep in zip(made.names, known, strict=True) if keep]
                log_file.joint_state(made.topic, int(made.t_ns[k]), log, names, row[known], speeds)
                continue
            t, _, picture, topic = made.pictures[k]
            if isinstance(picture, bytes):
                log_file.compressed_image(topic, t, log, picture)
            else:
                log_file.image(topic, t, log, picture)
        if made.extra is not None:
            made.extra(log_file)
    if made.spoil is not None:
        path.write_bytes(made.spoil(path.read_bytes()))
    return path


Make = Callable[[], Drive]


def odd_logs() -> dict[str, Make]:
    """Return how each odd log is made, by what is odd."""
    out: dict[str, Make] = {}
    for family in (_strays, _resets, _gaps, _wraps, _noise, _rates, _stamps, _joints, _pictures, _clocks, _files):
        for name, make in family():
            if name in out:
                raise AssertionError(f"{name} twice")
            out[name] = make
    return out


def _at(seconds: float) -> int:
    return round(seconds * 50)


def _changed(made: Drive, rows: Any, columns: Any, values: Any) -> Drive:
    phi = made.phi.copy()
    phi[rows, columns] = phi[rows, columns] + values
    return replace(made, phi=phi)


WHERE = {"at rest": 2 * PERIOD + 1.0, "in motion": 2 * PERIOD + STAND + 0.7}
WHEELS: dict[str, Any] = {"right": [0], "left": [1], "both": [0, 1]}


def _strays() -> Iterator[tuple[str, Make]]:
    for where, seconds in WHERE.items():
        for wheel, columns in WHEELS.items():
            for size in (0.1, 2.0, -1e3, 1e12):

                def make(s: float = seconds, c: Any = columns, v: float = size) -> Drive:
                    return _changed(sound(), _at(s), c, v)

                yield f"stray of {size:g} rad {where}, {wheel}", make
    for value in (np.nan, np.inf):
        yield f"one reading of {value}", lambda v=value: _changed(sound(), _at(8.0), [0], v)
    yield "ten strays", lambda: _changed(sound(), [_at(0.3 + 1.7 * k) for k in range(10)], [0] * 10, 3.0)


def _resets() -> Iterator[tuple[str, Make]]:
    for where, seconds in WHERE.items():
        for wheel, columns in WHEELS.items():
            for size in (-3.0, 40.0, -1000.0):

                def make(s: float = seconds, c: Any = columns, v: float = size) -> Drive:
                    made = sound()
                    phi = made.phi.copy()
                    for column in c:
                        phi[_at(s) :, column] += v
                    return replace(made, phi=phi)

                yield f"counter set anew by {size:g} rad {where}, {wheel}", make
    yield "counter set to zero at every stop", lambda: _zeroed(sound())


def _zeroed(made: Drive) -> Drive:
    phi = made.phi.copy()
    for k in range(1, STOPS):
        phi[_at(k * PERIOD + 1.0) :] -= phi[_at(k * PERIOD + 1.0)]
    return replace(made, phi=phi)


def _kept(made: Drive, keep: NDArray[np.bool_]) -> Drive:
    return replace(made, t_ns=made.t_ns[keep], log_ns=made.log_ns[keep], phi=made.phi[keep])


def _gaps() -> Iterator[tuple[str, Make]]:
    for where, seconds in WHERE.items():
        for length in (0.06, 0.3, 0.7, 1.0):

            def make(s: float = seconds, n: float = length) -> Drive:
                made = sound()
                t = (made.t_ns - T0_NS) / 1e9
                return _kept(made, ~((t > s - n / 2) & (t < s + n / 2)))

            yield f"no readings for {length:g} s {where}", make
            for wheel, column in (("right", 0), ("left", 1)):

                def alone(s: float = seconds, n: float = length, c: int = column) -> Drive:
                    made = sound()
                    t = (made.t_ns - T0_NS) / 1e9
                    phi = made.phi.copy()
                    phi[(t > s - n / 2) & (t < s + n / 2), c] = -np.inf  # the joint is missing in these messages
                    return replace(made, phi=phi)

                yield f"no {wheel} readings for {length:g} s {where}", alone
    for leg in range(STOPS - 1):

        def whole(k: int = leg) -> Drive:
            made = sound()
            t = (made.t_ns - T0_NS) / 1e9
            return _kept(made, ~((t > k * PERIOD + 1.7) & (t < (k + 1) * PERIOD + 0.2)))

        yield f"no readings on leg {leg}", whole
    yield "every third reading lost", lambda: _kept(sound(), np.arange(len(sound().t_ns)) % 3 != 0)
    yield (
        "half of the readings lost at random",
        lambda: _kept(sound(), np.random.default_rng(1).random(len(sound().t_ns)) < 0.5),
    )


def _wraps() -> Iterator[tuple[str, Make]]:
    step = np.deg2rad(0.1302)
    for low in (0.0, -np.pi):
        yield (
            f"angles modulo a turn from {low:.2f}",
            lambda v=low: replace(sound(), phi=np.mod(sound().phi - v, 2 * np.pi) + v),
        )
    for steps in (2**10, 2**11, 2**12, 1000, 2000, 9000):
        for low in (0, steps // 2):

            def make(n: int = steps, offset: int = low) -> Drive:
                made = sound()
                counts = np.round(made.phi / step)
                return replace(made, phi=(np.mod(counts + offset, n) - offset) * step)

            yield f"a counter of {steps} steps from {-low}", make


def _noise() -> Iterator[tuple[str, Make]]:
    for sigma in (1e-4, 5e-4, 1e-3, 2e-3, 5e-3):
        for step in (0.0, np.deg2rad(0.1302)):

            def make(s: float = sigma, q: float = step) -> Drive:
                made = sound()
                t_ns, phi_R, phi_L, _ = drive(stops=STOPS, stand=STAND, move=MOVE, step=0)
                phi = np.stack([phi_R, phi_L], axis=1) + s * np.random.default_rng(2).standard_normal((len(t_ns), 2))
                return replace(made, phi=np.floor(phi / q) * q if q else phi)

            yield f"noise of {sigma:g} rad, steps of {step:.3g}", make
    for step in (np.deg2rad(1.0), np.deg2rad(3.0), np.deg2rad(10.0)):
        yield f"steps of {np.rad2deg(step):.0f} deg", lambda q=step: replace(sound(), phi=np.floor(sound().phi / q) * q)
    yield "single precision", lambda: replace(sound(), phi=sound().phi.astype(np.float32).astype(np.float64))
    yield "far from zero", lambda: replace(sound(), phi=sound().phi + 1e5)


def _rates() -> Iterator[tuple[str, Make]]:
    for rate in (1.0, 2.0, 4.0, 10.0, 20.0, 100.0, 500.0):
        yield f"joints at {rate:g} Hz", lambda r=rate: sound(r)

    def jittered() -> Drive:
        made = sound()
        shift = np.random.default_rng(3).integers(-8_000_000, 8_000_000, len(made.t_ns))
        late = made.t_ns + shift
        right, left = (np.interp(late, made.t_ns, made.phi[:, k]) for k in (0, 1))
        return replace(made, t_ns=late, phi=np.stack([right, left], axis=1))

    yield "jittered stamps", jittered
    yield (
        "recorded in bursts of 20",
        lambda: replace(
            sound(),
            log_ns=np.repeat(sound().log_ns[19::20], 20)[: len(sound().t_ns)]
            if len(sound().t_ns) % 20 == 0
            else np.minimum.reduce([sound().log_ns + 400_000_000]),
        ),
    )


def _stamps() -> Iterator[tuple[str, Make]]:
    yield "no stamps on joints", lambda: replace(sound(), t_ns=np.zeros_like(sound().t_ns))
    yield (
        "no stamps on images",
        lambda: replace(
            sound(), pictures=tuple((0, log - 30_000_000, p, topic) for _, log, p, topic in sound().pictures)
        ),
    )
    for name, change in {
        "one stamp of zero": lambda t: np.where(np.arange(len(t)) == 300, 0, t),
        "a stamp an hour ahead": lambda t: np.where(np.arange(len(t)) == 300, t + 3_600_000_000_000, t),
        "a stamp an hour back": lambda t: np.where(np.arange(len(t)) == 300, t - 3_600_000_000_000, t),
        "stamps twice": lambda t: np.repeat(t[::2], 2)[: len(t)],
        "stamps to the nearest 0.1 s": lambda t: t // 100_000_000 * 100_000_000,
        "one stamp for all": lambda t: np.full_like(t, T0_NS),
        "stamps since the start": lambda t: t - T0_NS + 1,
    }.items():
        yield name, lambda f=change: replace(sound(), t_ns=f(sound().t_ns))

    def shuffled() -> Drive:
        made = sound()
        order = np.random.default_rng(4).permutation(len(made.t_ns))
        return replace(made, t_ns=made.t_ns[order], phi=made.phi[order])

    yield "recorded out of order", shuffled
    for name, change in {
        "images stamped alike": lambda k, t: T0_NS,
        "images stamped backwards": lambda k, t: 2 * T0_NS + round(6 * PERIOD * 1e9) - t,
        "one image stamped zero": lambda k, t: 0 if k == 4 else t,
        "one image a day ahead": lambda k, t: t + 86_400_000_000_000 if k == 4 else t,
    }.items():
        yield (
            name,
            lambda f=change: replace(
                sound(), pictures=tuple((f(k, t), *rest) for k, (t, *rest) in enumerate(sound().pictures))
            ),
        )


def _joints() -> Iterator[tuple[str, Make]]:
    for right, left in (
        ("wheel_FR", "wheel_FL"), ("motor_right", "motor_left"), ("right_track", "left_track"), ("a", "b"),
        ("right_wheel", "wheel"), ("right_wheel", "right_wheel_2"), ("", ""), ("R" * 300, "L"),
        ("right\0wheel", "left\0wheel"),
    ):  # fmt: skip
        yield f"joints called {right[:20]!r} and {left[:20]!r}", lambda r=right, w=left: replace(sound(), names=(r, w))
    yield (
        "wheels swapped from stop 3 on",
        lambda: replace(
            sound(),
            phi=np.where(np.arange(len(sound().t_ns))[:, None] > _at(3 * PERIOD), sound().phi[:, ::-1], sound().phi),
        ),
    )
    yield "wheels that never move", lambda: replace(sound(), phi=0 * sound().phi)
    yield "one wheel that never moves", lambda: replace(sound(), phi=sound().phi * [1, 0])
    yield "velocities, positions zero", lambda: _speeds(sound(100.0))
    yield "velocities without positions", lambda: _speeds(sound(100.0))

    def zeros(log: LogWriter) -> None:
        for t in sound().t_ns.tolist():
            log.joint_state("/joint_states", t + 5_000_000, t + 7_000_000, [LEFT, RIGHT], [0.0, 0.0])

    yield "a second publisher of zeros", lambda: replace(sound(), extra=zeros)

    def others(log: LogWriter) -> None:
        for t in sound().t_ns.tolist():
            log.joint_state("/arm/joint_states", t, t, ["left_arm", "gripper"], [1.0, np.nan])

    yield "an arm beside", lambda: replace(sound(), extra=others)

    def broken(log: LogWriter) -> None:
        for k in range(20):
            log.raw(
                "/joint_states", "sensor_msgs/msg/JointState", T0_NS + k, b"\0\1\0\0" + bytes(8) + b"\xff" * (k + 4)
            )

    yield "joint messages that do not decode", lambda: replace(sound(), extra=broken)

    def same(log: LogWriter) -> None:
        made = sound()
        for t, (right, left) in zip(made.t_ns.tolist(), made.phi, strict=True):
            log.joint_state("/copy", t, t, [LEFT, RIGHT], [left, right])

    yield "a copy of the joints", lambda: replace(sound(), extra=same)

    def different(log: LogWriter) -> None:
        made = sound()
        for t, (right, left) in zip(made.t_ns.tolist(), made.phi, strict=True):
            log.joint_state("/other", t, t, [LEFT, RIGHT], [0.5 * left, right])

    yield "another pair of wheels", lambda: replace(sound(), extra=different)


def _speeds(made: Drive) -> Drive:
    _, phi_R, phi_L, _ = drive(stops=STOPS, stand=STAND, move=MOVE, step=0, rate_hz=100.0)
    speed = np.stack([np.gradient(p, 0.01) for p in (phi_R, phi_L)], axis=1)
    return replace(made, phi=0 * made.phi, velocity=speed)


def _pictures() -> Iterator[tuple[str, Make]]:
    whole = jpeg(cv2.resize(blank(48, 64), (320, 240)))
    spoilt = {
        "empty": b"",
        "half": whole[: len(whole) // 2],
        "garbage": b"no picture",
        "other size": blank(24, 32),
        "black": np.zeros((48, 64), np.uint8),
    }
    for name, content in spoilt.items():
        for count in (1, 6):

            def make(c: Any = content, n: int = count) -> Drive:
                made = sound()
                pictures = tuple(
                    (t, log, c if k % 3 == 0 and k < 3 * n else p, CAMERA if not isinstance(c, bytes) else COMPRESSED)
                    if not isinstance(c, bytes)
                    else (t, log, c if k % 3 == 0 and k < 3 * n else cv2.imencode(".png", p)[1].tobytes(), COMPRESSED)
                    for k, (t, log, p, _) in enumerate(made.pictures)
                )
                return replace(made, pictures=pictures)

            yield f"{count} images {name}", make
    yield "no images", lambda: replace(sound(), pictures=())
    yield (
        "images in motion only",
        lambda: replace(
            sound(), pictures=tuple((t + 1_700_000_000, log + 1_700_000_000, p, c) for t, log, p, c in sound().pictures)
        ),
    )
    yield (
        "two cameras",
        lambda: replace(
            sound(),
            pictures=sound().pictures + tuple((t, log, p, "/rear/image_raw") for t, log, p, _ in sound().pictures),
        ),
    )
    yield (
        "a depth camera beside",
        lambda: replace(
            sound(),
            pictures=sound().pictures + tuple((t, log, p, "/camera/depth/image") for t, log, p, _ in sound().pictures),
        ),
    )
    for ending in (".png", ".webp", ".tiff"):
        yield (
            f"pictures as {ending[1:]}",
            lambda e=ending: replace(
                sound(),
                pictures=tuple(
                    (
                        t,
                        log,
                        cv2.imencode(e, p, [cv2.IMWRITE_WEBP_QUALITY, 101] if e == ".webp" else [])[1].tobytes(),
                        COMPRESSED,
                    )
                    for t, log, p, _ in sound().pictures
                ),
            ),
        )


def _clocks() -> Iterator[tuple[str, Make]]:
    for seconds in (-86_400.0, -30.0, -1.5, 1.5, 30.0, 86_400.0, 1e7):
        yield (
            f"camera's clock {seconds:+g} s",
            lambda s=seconds: replace(
                sound(), pictures=tuple((t + round(s * 1e9), log, p, c) for t, log, p, c in sound().pictures)
            ),
        )
    yield (
        "recorded an hour late",
        lambda: replace(
            sound(),
            log_ns=sound().log_ns + 3_600_000_000_000,
            pictures=tuple((t, log + 3_600_000_000_000, p, c) for t, log, p, c in sound().pictures),
        ),
    )


def _files() -> Iterator[tuple[str, Make]]:
    for compression in ("none", "lz4", "zstd"):
        for part in (0.3, 0.6, 0.85, 0.99):
            yield (
                f"cut at {part:.0%}, {compression}",
                lambda c=compression, p=part: replace(
                    sound(), writer={"compression": c}, spoil=lambda data: data[: int(len(data) * p)]
                ),
            )
        for seed in range(4):
            yield (
                f"flipped bits {seed}, {compression}",
                lambda c=compression, s=seed: replace(
                    sound(), writer={"compression": c}, spoil=lambda data: _flipped(data, s)
                ),
            )
    for flip in (1, 2, 4, 8, 16, 32, 64, 128):
        yield f"a chunk's opcode xor {flip}", lambda f=flip: replace(sound(), spoil=lambda data: _opcode(data, f))
    yield "a hole of zeros", lambda: replace(sound(), spoil=lambda data: data[:4000] + bytes(3000) + data[7000:])
    yield "3000 bytes missing", lambda: replace(sound(), spoil=lambda data: data[:4000] + data[7000:])
    yield (
        "3000 bytes more",
        lambda: replace(sound(), spoil=lambda data: data[:4000] + bytes(range(250)) * 12 + data[4000:]),
    )
    yield "text behind the end", lambda: replace(sound(), spoil=lambda data: data + b"more" * 100)
    yield "no file but zeros", lambda: replace(sound(), spoil=lambda data: bytes(len(data)))
    yield "an empty file", lambda: replace(sound(), spoil=lambda data: b"")


def _flipped(data: bytes, seed: int) -> bytes:
    out, rng = bytearray(data), np.random.default_rng(seed)
    for at in rng.integers(8, len(data), 3):
        out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _opcode(data: bytes, flip: int) -> bytes:
    out, at, chunks = bytearray(data), 8, 0
    while at + 9 < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        chunks += opcode == 6
        if chunks == 3:
            out[at] ^= flip
            return bytes(out)
        at += 9 + length
    return bytes(out)
