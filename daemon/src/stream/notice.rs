//! What a feed tells its user on standard error: once when it begins to wait, and once when it goes on.

use crate::printable::Printable;

/// What was told last.
#[derive(Debug, Default)]
pub struct Notice {
    waiting: Option<String>,
}

impl Notice {
    /// It waits; `why` is told if it has changed.
    pub fn waits(&mut self, why: String) {
        if self.waiting.as_ref() != Some(&why) {
            eprintln!("lookout: {}", Printable(&why));
            self.waiting = Some(why);
        }
    }

    /// It goes on.
    pub fn goes_on(&mut self, what: &str) {
        if self.waiting.take().is_some() {
            eprintln!("lookout: {}", Printable(what));
        }
    }
}
