//! A scripted pair of cameras for tests, with a simulated clock.

use super::{Camera, CameraError, Exposure, Opener, Taken};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

thread_local! {
    static NOW_NS: Cell<u64> = const { Cell::new(0) };
}

/// The simulated clock.
pub fn now_ns() -> u64 {
    NOW_NS.get()
}

/// A scripted event of one camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A uniform frame of one grey level is exposed and available.
    Frame { at_ns: u64, level: u8 },
    /// The camera is unplugged.
    Unplug { at_ns: u64 },
    /// The camera can be opened again.
    Plug { at_ns: u64 },
}

impl Event {
    fn at_ns(self) -> u64 {
        let (Self::Frame { at_ns, .. } | Self::Unplug { at_ns } | Self::Plug { at_ns }) = self;
        at_ns
    }
}

#[derive(Default)]
struct Side {
    events: VecDeque<Event>,
    is_gone: bool,
    opened: u32,
    exposures: Vec<Exposure>,
}

/// Both scripted cameras.
#[derive(Clone)]
pub struct FakeRig {
    sides: Rc<RefCell<[Side; 2]>>,
    end_ns: u64,
}

impl FakeRig {
    /// Cameras with one script each, in order of time.
    pub fn new(scripts: [Vec<Event>; 2]) -> Self {
        NOW_NS.set(0);
        let end_ns = scripts.iter().flatten().map(|e| e.at_ns()).max().unwrap_or(0);
        let sides = scripts.map(|s| Side { events: s.into(), ..Side::default() });
        Self { sides: Rc::new(RefCell::new(sides)), end_ns }
    }

    pub fn opener(&self) -> Box<dyn Opener> {
        Box::new(self.clone())
    }

    pub fn is_over(&self) -> bool {
        now_ns() > self.end_ns + 100_000_000
    }

    pub fn opened(&self, side: usize) -> u32 {
        self.sides.borrow()[side].opened
    }

    pub fn exposures(&self) -> [Vec<Exposure>; 2] {
        let sides = self.sides.borrow();
        [sides[0].exposures.clone(), sides[1].exposures.clone()]
    }
}

impl Opener for FakeRig {
    fn open(&mut self, side: usize, size: (usize, usize)) -> Result<Box<dyn Camera>, CameraError> {
        NOW_NS.set(now_ns() + 1_000_000);
        let mut sides = self.sides.borrow_mut();
        let own = &mut sides[side];
        if let Some(Event::Plug { at_ns }) = own.events.front().copied()
            && at_ns <= now_ns()
        {
            own.events.pop_front();
            own.is_gone = false;
        }
        let device = ["fake left", "fake right"][side].to_owned();
        if own.is_gone {
            return Err(CameraError { device, reason: "not there".into() });
        }
        // Frames exposed before the camera was opened are lost.
        while own.events.front().is_some_and(|e| matches!(e, Event::Frame { at_ns, .. } if *at_ns < now_ns()))
        {
            own.events.pop_front();
        }
        own.opened += 1;
        Ok(Box::new(FakeCamera { rig: self.clone(), side, device, width: size.0 }))
    }
}

struct FakeCamera {
    rig: FakeRig,
    side: usize,
    device: String,
    width: usize,
}

impl Camera for FakeCamera {
    fn grab(&mut self, patience: Duration, grey: &mut [u8]) -> Result<Option<Taken>, CameraError> {
        let mut sides = self.rig.sides.borrow_mut();
        let own = &mut sides[self.side];
        let until = now_ns() + patience.as_nanos() as u64;
        match own.events.front().copied() {
            Some(event) if event.at_ns() <= until => {
                NOW_NS.set(now_ns().max(event.at_ns()));
                own.events.pop_front();
                let Event::Frame { at_ns, level } = event else {
                    own.is_gone = true;
                    return Err(CameraError { device: self.device.clone(), reason: "unplugged".into() });
                };
                // The right half of a side-by-side image is brighter.
                let width = self.width;
                for (i, pixel) in grey.iter_mut().enumerate() {
                    *pixel = if width > 4 && i % width >= width / 2 { level + 100 } else { level };
                }
                Ok(Some(Taken { time_ns: at_ns, sequence: 0 }))
            }
            _ => {
                NOW_NS.set(until);
                Ok(None)
            }
        }
    }

    fn set_exposure(&mut self, exposure: Exposure) -> Result<(), CameraError> {
        self.rig.sides.borrow_mut()[self.side].exposures.push(exposure);
        Ok(())
    }
}
