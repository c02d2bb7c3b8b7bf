"""The client, and a frame."""

import ctypes
import time

import numpy

from . import _layout
from ._library import load

# Python handles signals between two calls of the library: ctrl-C is heard within this time.
_SLICE_S = 0.1


class Error(Exception):
    """A daemon cannot be read."""


class Frame:
    """The results of one frame.

    The records (`alarm`, `obstacles`, `motion`, `vehicle`, `rig`) are copies of a few kB. The pictures (`disparity`,
    `confidence`, `left`, `right`) are read in place: they hold this frame only until the next one is taken from the client. An
    array of them that is used after that shows other data, or ends the program when the daemon has ended: `.copy()` what has
    to stay.
    """

    def __init__(self, client, raw):
        self._client = client
        self._number = client._number
        #: Number of the pair in its run; `run` and `sequence` identify a frame.
        self.sequence = raw.sequence
        #: The run: other letters and digits at each start of the daemon.
        self.run = raw.run.decode()
        #: Time of the source, in ns.
        self.source_ns = raw.source_ns
        #: When the pair was captured, in ns of CLOCK_MONOTONIC; 0 where the daemon itself has ended.
        self.capture_ns = raw.capture_ns
        #: When the result was complete, in ns of CLOCK_MONOTONIC; 0 where it is withdrawn.
        self.result_ns = raw.result_ns
        #: Whether the results of this frame and of all earlier ones no longer hold.
        self.withdrawn = bool(raw.withdrawn)
        #: Why the alarm has its level, in words.
        self.reason = raw.reason.decode()
        #: Width and height of the pictures, in pixels; 0 where the daemon itself has ended.
        self.width, self.height = raw.width, raw.height
        #: How stages treated the frame: bits of `MODE_…`.
        self.modes = raw.modes
        #: Alarm, road, path, and in `space` free space and boundaries.
        self.alarm = _record(raw.alarm, _layout.ALARM)
        #: The obstacles, one element each, the oldest track first.
        self.obstacles = _records(raw.obstacles, _layout.OBSTACLE, raw.obstacle_count)
        #: The vehicle's own motion; unknown unless its `health` has `HEALTH_KNOWN`.
        self.motion = _record(raw.motion, _layout.MOTION)
        #: What the vehicle's bus reported; which values there are is in its field `present`.
        self.vehicle = _record(raw.vehicle, _layout.VEHICLE)
        #: Frame size and rectified rig; all zeros until the daemon has told it.
        self.rig = _record(raw.rig, _layout.RIG)
        #: Name of the alarm's level: off, clear, warning or alarm.
        self.level = client._library.lookout_level_name(int(self.alarm["level"])).decode()
        self._pictures = {name: getattr(raw, name) for name in ("disparity", "confidence", "left", "right")}

    @property
    def age_s(self):
        """Time since the pair was captured, in seconds."""
        return (time.clock_gettime_ns(time.CLOCK_MONOTONIC) - self.capture_ns) * 1e-9

    @property
    def disparity(self):
        """Disparity in 1/256 px, 0 = unknown: a view of `height` × `width` uint16; None without pictures."""
        return self._picture("disparity", numpy.uint16)

    @property
    def confidence(self):
        """Confidence of the disparity, 1 to 255, 0 where it is unknown: a view of uint8; None without pictures."""
        return self._picture("confidence", numpy.uint8)

    @property
    def left(self):
        """Left rectified picture: a view of uint8; None without pictures."""
        return self._picture("left", numpy.uint8)

    @property
    def right(self):
        """Right rectified picture as it was matched: a view of uint8; None without pictures."""
        return self._picture("right", numpy.uint8)

    def _picture(self, name, dtype):
        if self._number != self._client._number:
            raise ValueError("the client has taken another frame since: copy() the pictures that have to stay")
        address = self._pictures[name]
        if not address:
            return None
        size = self.width * self.height * numpy.dtype(dtype).itemsize
        view = numpy.frombuffer((ctypes.c_char * size).from_address(address), dtype)
        # The memory is mapped for reading alone.
        view.flags.writeable = False
        return view.reshape(self.height, self.width)


def _records(address, dtype, count):
    return numpy.frombuffer(ctypes.string_at(address, dtype.itemsize * count), dtype)


def _record(address, dtype):
    return _records(address, dtype, 1)[0]


class Client:
    """Reads a daemon's results: the newest frame, each at most once, from run to run. Use it in one thread.

    `instance` and `directory` are the keys `instance.name` and `instance.directory` of the daemon's configuration. With
    `pictures`, frames come with the disparity map and its pictures. Iterating waits for frames for ever.
    """

    def __init__(self, instance=None, directory=None, pictures=False):
        self._client = None
        self._number = 0
        self._library = load()
        encoded = [None if text is None else str(text).encode() for text in (instance, directory)]
        options = _layout.Options(_layout.LAYOUT, int(pictures), *encoded)
        error = ctypes.create_string_buffer(512)
        self._client = self._library.lookout_open(ctypes.byref(options), error, len(error))
        if not self._client:
            raise Error(error.value.decode(errors="replace"))

    def next(self, timeout_s=None):
        """The newest frame that was not given before; None if none came within `timeout_s` seconds.

        Raises Error if there is a daemon that could not be read in that time, also where `timeout_s` is None.
        """
        if not self._client:
            raise Error("the client is closed")
        self._number += 1
        raw = _layout.Frame()
        until = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left = _SLICE_S if until is None else min(_SLICE_S, max(0.0, until - time.monotonic()))
            found = self._library.lookout_next(self._client, round(left * 1000), ctypes.byref(raw))
            if found == 1:
                return Frame(self, raw)
            is_over = until is not None and time.monotonic() >= until
            if found < 0 and (is_over or until is None):
                raise Error(self.waits)
            if is_over:
                return None

    @property
    def waits(self):
        """Why there are no frames; empty while they come."""
        return self._library.lookout_error(self._client).decode(errors="replace") if self._client else "the client is closed"

    def close(self):
        """Returns the pictures to the daemon and leaves its run."""
        client, self._client = self._client, None
        self._number += 1
        if client:
            self._library.lookout_close(client)

    def __iter__(self):
        while True:
            yield self.next()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __del__(self):
        if getattr(self, "_client", None):
            self.close()
