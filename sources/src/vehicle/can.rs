//! The CAN bus by SocketCAN.

use super::decoder::Decoder;
use super::frame::Frame;
use socketcan::{CanAnyFrame, CanFdSocket, CanFilter, EmbeddedFrame, Frame as _, Socket, SocketOptions};
use std::io;
use std::time::{Duration, SystemTime};

/// Flags in the identifier of SocketCAN: extended, remote request.
const EXTENDED: u32 = 1 << 31;
/// See [`EXTENDED`].
const REMOTE: u32 = 1 << 30;

/// Largest age of a kernel timestamp that is used: older ones mean that the clock was set in between.
const MAX_DELAY: Duration = Duration::from_secs(10);

/// An open bus. It receives only the frames that a decoder needs.
#[derive(Debug)]
pub struct CanBus {
    socket: CanFdSocket,
}

impl CanBus {
    /// Opens an interface, such as `can0`, for the frames of a decoder. [`Self::receive`] waits at most `patience`.
    ///
    /// # Errors
    /// When there is no such interface, or the system refuses.
    pub fn open(interface: &str, decoder: &Decoder, patience: Duration) -> io::Result<Self> {
        let socket = CanFdSocket::open(interface)?;
        let filters: Vec<CanFilter> = decoder
            .ids()
            .iter()
            .map(|id| {
                // Bit and mask of the kind: a standard identifier does not match an extended one.
                let (flag, bits) = if id.is_extended { (EXTENDED, 0x1fff_ffff) } else { (0, 0x7ff) };
                CanFilter::new(id.number | flag, bits | EXTENDED | REMOTE)
            })
            .collect();
        socket.set_filters(&filters)?;
        socket.set_recv_timestamp(true)?;
        socket.set_read_timeout(patience)?;
        Ok(Self { socket })
    }

    /// The next data frame and how long ago the kernel received it; `None` if none came in time.
    ///
    /// # Errors
    /// When the interface went down or away.
    pub fn receive(&self) -> io::Result<Option<(Frame, Duration)>> {
        let (frame, times) = match self.socket.read_frame_with_timestamps() {
            Ok(read) => read,
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                ) =>
            {
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        let age = times.socket.and_then(|at| SystemTime::now().duration_since(at).ok());
        let age = age.filter(|age| *age <= MAX_DELAY).unwrap_or_default();
        let read = |id: u32, is_extended: bool, data: &[u8]| Some((Frame::new(id, is_extended, data), age));
        Ok(match &frame {
            CanAnyFrame::Normal(f) => read(f.raw_id(), f.is_extended(), f.data()),
            CanAnyFrame::Fd(f) => read(f.raw_id(), f.is_extended(), f.data()),
            CanAnyFrame::Remote(_) | CanAnyFrame::Error(_) => None,
        })
    }
}
