//! Reconnection of a lost camera: a pure state machine; the caller passes the time.

/// Time limits, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionParameters {
    /// A camera that delivers no frame for this long is lost.
    pub silence_ns: u64,
    /// Delay before the first attempt to reopen; it doubles with each attempt.
    pub retry_initial_ns: u64,
    /// Upper limit of that delay.
    pub retry_max_ns: u64,
}

/// What the caller has to do now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Open the camera.
    Open,
    /// Grab frames.
    Grab,
    /// Close the camera: it has been silent for too long.
    Close,
    /// Nothing: the next attempt is not due yet.
    Wait,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Closed { retry_ns: u64 },
    Open { heard_ns: u64 },
}

/// Connection state of one camera.
#[derive(Clone, Debug)]
pub struct Connection {
    parameters: ConnectionParameters,
    state: State,
    wait_ns: u64,
    /// Frames since the camera was opened.
    frames: u64,
    losses: u64,
}

impl Connection {
    /// A camera that was never opened: the first attempt is due at once.
    pub fn new(parameters: ConnectionParameters) -> Self {
        let wait_ns = parameters.retry_initial_ns;
        Self { parameters, state: State::Closed { retry_ns: 0 }, wait_ns, frames: 0, losses: 0 }
    }

    /// What to do at time `now_ns`.
    pub fn action(&self, now_ns: u64) -> Action {
        match self.state {
            State::Closed { retry_ns } if now_ns >= retry_ns => Action::Open,
            State::Closed { .. } => Action::Wait,
            State::Open { heard_ns } if now_ns.saturating_sub(heard_ns) > self.parameters.silence_ns => {
                Action::Close
            }
            State::Open { .. } => Action::Grab,
        }
    }

    /// The camera was opened.
    pub fn opened(&mut self, now_ns: u64) {
        self.frames = 0;
        self.state = State::Open { heard_ns: now_ns };
    }

    /// A frame arrived.
    pub fn frame(&mut self, now_ns: u64) {
        self.frames += 1;
        // Only a camera that delivers frames resets the delay.
        self.wait_ns = self.parameters.retry_initial_ns;
        self.state = State::Open { heard_ns: now_ns };
    }

    /// Opening failed, or the camera was lost. Returns the time until the next attempt.
    pub fn failed(&mut self, now_ns: u64) -> u64 {
        self.losses += u64::from(self.frames > 0);
        self.frames = 0;
        let wait_ns = self.wait_ns;
        self.wait_ns = wait_ns.saturating_mul(2).min(self.parameters.retry_max_ns);
        self.state = State::Closed { retry_ns: now_ns.saturating_add(wait_ns) };
        wait_ns
    }

    /// Whether the camera is open.
    pub fn is_open(&self) -> bool {
        matches!(self.state, State::Open { .. })
    }

    /// How often the camera was lost after it had delivered frames.
    pub fn losses(&self) -> u64 {
        self.losses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn connection() -> Connection {
        let parameters = ConnectionParameters { silence_ns: S, retry_initial_ns: S / 2, retry_max_ns: 4 * S };
        Connection::new(parameters)
    }

    #[test]
    fn attempts_become_rarer_until_it_works_again() {
        let mut c = connection();
        assert_eq!(c.action(0), Action::Open);
        let mut now = 0;
        let mut waits = Vec::new();
        for _ in 0..6 {
            let wait = c.failed(now);
            waits.push(wait);
            assert_eq!(c.action(now + wait - 1), Action::Wait);
            now += wait;
            assert_eq!(c.action(now), Action::Open);
        }
        assert_eq!(waits, [S / 2, S, 2 * S, 4 * S, 4 * S, 4 * S]);
        // Opening alone does not reset the delay.
        c.opened(now);
        assert_eq!(c.failed(now), 4 * S);
        c.opened(now);
        c.frame(now);
        assert_eq!((c.failed(now), c.losses()), (S / 2, 1));
    }

    #[test]
    fn a_silent_camera_is_closed() {
        let mut c = connection();
        c.opened(10 * S);
        assert_eq!(c.action(11 * S), Action::Grab);
        c.frame(11 * S);
        assert_eq!(c.action(12 * S), Action::Grab);
        assert_eq!(c.action(12 * S + 1), Action::Close);
        // A clock that appears to run backwards closes nothing.
        assert_eq!(c.action(0), Action::Grab);
    }
}
