//! A port to a CAN interface by SocketCAN.

use super::encoder::OutFrame;
use super::link::{Port, Received};
use socketcan::{
    CanFilter, CanFrame, CanSocket, EmbeddedFrame, ExtendedId, Id, Socket, SocketOptions, StandardId,
};
use std::io;

/// Flags and classes in the identifier of SocketCAN (linux/can.h, linux/can/error.h).
const EXTENDED: u32 = 1 << 31;
/// Remote request.
const REMOTE: u32 = 1 << 30;
/// Notice of the controller instead of a frame.
const NOTICE: u32 = 1 << 29;
/// Class of notices: bus off.
const BUS_OFF: u32 = 0x40;
/// Class of notices: the controller was restarted.
const RESTARTED: u32 = 0x100;

/// The kernel's error when the queue of an interface has no room (ENOBUFS).
const NO_BUFFER: i32 = 105;

/// An interface such as `can0`. Closed when it is dropped.
#[derive(Debug)]
pub struct SocketPort {
    interface: String,
    socket: Option<CanSocket>,
}

impl SocketPort {
    /// A port that is not open yet.
    pub fn new(interface: &str) -> Self {
        Self { interface: interface.to_owned(), socket: None }
    }

    fn socket(&self) -> io::Result<&CanSocket> {
        self.socket.as_ref().ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Port for SocketPort {
    fn open(&mut self, watch: &OutFrame) -> io::Result<()> {
        let socket = CanSocket::open(&self.interface)?;
        let (flag, bits) = if watch.is_extended { (EXTENDED, 0x1fff_ffff) } else { (0, 0x7ff) };
        socket.set_filters(&[CanFilter::new(watch.id | flag, bits | EXTENDED | REMOTE)])?;
        socket.set_error_filter(BUS_OFF | RESTARTED)?;
        // A frame comes back when it was sent.
        socket.set_recv_own_msgs(true)?;
        socket.set_nonblocking(true)?;
        self.socket = Some(socket);
        Ok(())
    }

    fn close(&mut self) {
        self.socket = None;
    }

    fn send(&mut self, frame: &OutFrame) -> io::Result<()> {
        let id = if frame.is_extended {
            ExtendedId::new(frame.id).map(Id::Extended)
        } else {
            u16::try_from(frame.id).ok().and_then(StandardId::new).map(Id::Standard)
        };
        let frame = id.and_then(|id| CanFrame::new(id, &frame.data)).ok_or(io::ErrorKind::InvalidInput)?;
        self.socket()?.write_frame(&frame).map_err(|error| match error.raw_os_error() {
            Some(NO_BUFFER) => io::ErrorKind::WouldBlock.into(),
            _ => error,
        })
    }

    fn receive(&mut self) -> io::Result<Option<Received>> {
        match self.socket()?.read_raw_frame() {
            Ok(frame) if frame.can_id & NOTICE == 0 => Ok(Some(Received::Watched(frame.data))),
            Ok(frame) if frame.can_id & BUS_OFF != 0 => Ok(Some(Received::BusOff)),
            Ok(frame) if frame.can_id & RESTARTED != 0 => Ok(Some(Received::Restarted)),
            Ok(_) => Ok(Some(Received::Other)),
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}
