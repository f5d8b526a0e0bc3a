"""What reading a recording costs: against the streaming floor and the libraries, and bytes and memory of long ones.

Example:
  python benchmarks/logs.py                    a mixed log of 100 MB: time against the floor, rosbags and mcap
  python benchmarks/logs.py --long-gb 2        and a camera log of 2 GB: bytes read and peak memory
  python benchmarks/logs.py --damage           and seeded cuts and flips of a log that calibrates

The streaming floor reads the file, unpacks every chunk and checks its CRC, and does nothing else. Times are processor
times of seven rounds: the least of each, and the median of its ratios to the floor of the same round.
"""

import argparse
import resource
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.calibrate import calibrate
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.stops import find_stops
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

STORE = get_typestore(Stores.ROS2_HUMBLE)
T0_NS = 1_700_000_000_000_000_000
ENOUGH_STOPS = 5
CHUNK_BYTES = 768 << 10
"""rosbag2's default."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mb", type=float, default=100.0, help="size of the mixed log (100)")
    parser.add_argument("--long-gb", type=float, default=0.0, help="size of the camera log")
    parser.add_argument("--damage", action="store_true", help="seeded cuts and flips")
    parser.add_argument("--inner", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inner:
        measure_long(args.inner)
        return
    with tempfile.TemporaryDirectory() as folder:
        mixed = write_mixed(Path(folder) / "mixed.mcap", args.mb * 1e6)
        print(f"mixed log: {mixed.stat().st_size / 1e6:.0f} MB, JPEG 30 Hz, joints 200 Hz, IMU 400 Hz, TF 100 Hz")
        speeds(mixed)
        mixed.unlink()
        if args.long_gb:
            long = write_mixed(Path(folder) / "long.mcap", args.long_gb * 1e9, busy=False)
            print(f"\ncamera log: {long.stat().st_size / 1e9:.2f} GB")
            subprocess.run([sys.executable, __file__, "--inner", str(long)], check=True)
            long.unlink()
        if args.damage:
            damage(Path(folder))


def speeds(path: Path, rounds: int = 7) -> None:
    """Print processor times: all in each round, one after the other, as ratios to that round's floor."""
    works: dict[str, Callable[[], object]] = {
        "streaming floor with CRC": lambda: stream_floor(path),
        "open_recording": lambda: open_recording(path, hashed=False),
        "... with the SHA-256": lambda: open_recording(path),
        "rosbags, raw messages": lambda: rosbags_raw(path),
        "mcap, raw messages": lambda: mcap_raw(path),
    }
    times = np.array([[processor_time(work) for work in works.values()] for _ in range(rounds)])
    ratios = np.median(times / times[:, :1], axis=0)
    for name, seconds, ratio in zip(works, times.min(axis=0), ratios, strict=True):
        print(f"  {name:28} {seconds:7.3f} s   {ratio:5.2f} x the floor")


def processor_time(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def stream_floor(path: Path) -> int:
    total = 0
    unpack = zstandard.ZstdDecompressor()
    with path.open("rb") as file:
        file.read(8)
        while True:
            head = file.read(9)
            opcode, length = struct.unpack("<BQ", head)
            body = file.read(length)
            if opcode == 2:
                return total
            if opcode == 6:
                size, crc, name = struct.unpack_from("<QII", body, 16)
                data = unpack.decompress(body[32 + name + 8 :], max_output_size=size)
                if zlib.crc32(data) != crc:
                    raise ValueError("a chunk's checksum")
                total += len(data)


def rosbags_raw(path: Path) -> int:
    with AnyReader([path]) as reader:
        return sum(1 for _ in reader.messages())


def mcap_raw(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


def write_mixed(path: Path, size: float, *, busy: bool = True) -> Path:
    """Write a log as ``ros2 bag record`` does: chunks of zstd, the camera at 30 Hz, the robot standing every 6 s."""
    rng = np.random.default_rng(0)
    pictures = [jpeg(rng) for _ in range(40)]
    serialise = STORE.serialize_cdr
    t_ns, k = T0_NS, 0
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES)
        writer.start(profile="ros2")
        channels = {}
        for topic, kind in (
            ("/joint_states", "sensor_msgs/msg/JointState"),
            ("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage"),
            ("/imu", "sensor_msgs/msg/Imu"),
            ("/tf", "tf2_msgs/msg/TFMessage"),
        ):
            text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
            channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text))

        def put(topic: str, kind: str, message: object) -> None:
            writer.add_message(channels[topic], t_ns, bytes(serialise(message, kind)), t_ns)

        while file.tell() < size:
            t_ns = T0_NS + k * 2_500_000
            if k % 2 == 0:
                put("/joint_states", "sensor_msgs/msg/JointState", joints(t_ns, k * 2.5e-3))
            if k % 13 == 0:
                put("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", image(t_ns, pictures[k % 40]))
            if busy:
                put("/imu", "sensor_msgs/msg/Imu", imu(t_ns))
                if k % 4 == 0:
                    put("/tf", "tf2_msgs/msg/TFMessage", transform(t_ns))
            k += 1
        writer.finish()
    return path


def jpeg(rng: np.random.Generator) -> bytes:
    noise = cv2.GaussianBlur(rng.integers(0, 256, (480, 640), dtype=np.uint8), (0, 0), 1.5)
    return cv2.imencode(".jpg", noise, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()


def header(t_ns: int) -> object:
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link")


def joints(t_ns: int, t: float) -> object:
    """Return angles of a robot that stands for 2 s and drives for 4 s, by turns."""
    leg, within = divmod(t, 6.0)
    x = min(max(within - 2.0, 0.0) / 4.0, 1.0)
    done = leg + x - np.sin(2 * np.pi * x) / (2 * np.pi)
    phi = np.floor(np.array([8.1, 7.3]) * done / 0.00227) * 0.00227
    return STORE.types["sensor_msgs/msg/JointState"](
        header=header(t_ns),
        name=["left_wheel_joint", "right_wheel_joint"],
        position=phi,
        velocity=np.zeros(2),
        effort=np.zeros(2),
    )


def image(t_ns: int, content: bytes) -> object:
    data = np.frombuffer(content, dtype=np.uint8)
    return STORE.types["sensor_msgs/msg/CompressedImage"](header=header(t_ns), format="jpeg", data=data)


def imu(t_ns: int) -> object:
    vector = STORE.types["geometry_msgs/msg/Vector3"](x=0.01, y=t_ns % 1000 * 1e-3, z=9.81)
    turn = STORE.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    cov = np.zeros(9)
    return STORE.types["sensor_msgs/msg/Imu"](
        header=header(t_ns),
        orientation=turn,
        orientation_covariance=cov,
        angular_velocity=vector,
        angular_velocity_covariance=cov,
        linear_acceleration=vector,
        linear_acceleration_covariance=cov,
    )


def transform(t_ns: int) -> object:
    types = STORE.types
    pose = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0),
        rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    one = types["geometry_msgs/msg/TransformStamped"](header=header(t_ns), child_frame_id="base_link", transform=pose)
    return types["tf2_msgs/msg/TFMessage"](transforms=[one])


def measure_long(path: Path) -> None:
    """Print what reading a long log takes: its wheels, and the frames of every stop (at most 20 each)."""
    from boxcal.detect.extract import frames_at  # noqa: PLC0415

    def count(name: str) -> int:
        lines = Path("/proc/self/io").read_text().splitlines()
        return int(next(line for line in lines if line.startswith(name)).split()[1])

    before_kb, before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, count("rchar")
    begun = time.process_time()
    recording = open_recording(path)
    opened = time.process_time() - begun
    stops = find_stops(recording.wheels)
    frames = 0
    for stop in stops:
        frames += sum(1 for _ in recording.read_frames(frames_at(recording, stop, 0.1, 20)))
    cache = recording.source.cache
    kept = sum(length for _, length in cache.places.values())
    read, peak_kb = count("rchar") - before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    size = path.stat().st_size
    print(f"  {len(stops)} stops, {frames} frames looked at; opened in {opened:.1f} s of processor time")
    print(f"  bytes read from the recording: {(read - cache.read_back) / size:.3f} times its size")
    print(f"  frames kept in passing: {kept / 1e6:.0f} MB; read back from a file: {cache.read_back / 1e6:.0f} MB")
    print(f"  peak memory: {peak_kb / 1024:.0f} MB beyond imports")


def damage(folder: Path, reads: int = 1000, calibrations: int = 40) -> None:
    """Print what becomes of seeded cuts and flips of a log that calibrates: read, and cut ones calibrated."""
    rng = np.random.default_rng(7)
    robot, target = khepera("good"), make_target()
    drive = simulate_drive(robot, target, DriveOptions(stops=9, slip=2e-4), rng)
    sound = folder / "good.mcap"
    write_log(sound, robot, target, drive, RecordOptions(frames=1, moving_frames=0), rng=rng)
    content, right = sound.read_bytes(), open_recording(sound)
    print(f"\ndamaged copies of a log of {len(content) / 1e3:.0f} kB, {reads} of them")
    counts: dict[str, int] = {}
    path = folder / "damaged.mcap"
    for k in range(reads):
        path.write_bytes(content[: int(rng.integers(len(content)))] if k % 2 else flipped(content, rng))
        what = outcome(path, right)
        counts[what] = counts.get(what, 0) + 1
        if what == "WRONG":
            print(f"  wrong: damage {k}")
    for what, count in sorted(counts.items()):
        print(f"  {what:24} {count}")
    enough = done = 0
    for _ in range(calibrations):
        path.write_bytes(content[: int(len(content) * rng.uniform(0.4, 1.0))])
        try:
            found = open_recording(path)
        except DetectError:
            continue
        stands = [s for s in find_stops(found.wheels) if found.frames_between(s.t_start_ns, s.t_end_ns).size]
        if len(stands) < ENOUGH_STOPS:
            continue
        enough += 1
        try:
            result = calibrate(path, target)
            done += abs(result.wheels.b / robot.b - 1) < 0.02
        except BoxcalError as error:
            print(f"  {len(stands)} stops left: {error}")
    print(f"  of {enough} cut logs with {ENOUGH_STOPS} stops or more, {done} calibrate rightly")


def flipped(content: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(content)
    for at in rng.integers(8, len(out), rng.integers(1, 5)):
        out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def outcome(path: Path, right: Recording) -> str:
    """Return whether a damaged log is read rightly, rightly and warned, refused in one line, or wrongly."""
    try:
        found = open_recording(path)
    except DetectError:
        return "one clear line"
    at = np.searchsorted(right.wheels.t_ns, found.wheels.t_ns)
    if np.any(at >= len(right.wheels)) or np.any(right.wheels.t_ns[at] != found.wheels.t_ns):
        return "WRONG"
    same = np.array_equal(found.wheels.phi_R, right.wheels.phi_R[at])
    images = dict(right.read_frames(range(right.frame_t_ns.size)))
    shown = found.read_frames(range(found.frame_t_ns.size))
    same = same and all(t in images and np.array_equal(image, images[t]) for t, image in shown)
    whole = len(found.wheels) == len(right.wheels) and found.frame_t_ns.size == right.frame_t_ns.size
    return "WRONG" if not same or not (whole or found.notes) else "right and warned" if found.notes else "right"


if __name__ == "__main__":
    main()
