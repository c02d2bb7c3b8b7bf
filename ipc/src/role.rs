//! The processes of the daemon.

use std::fmt;
use std::str::FromStr;

/// What a process does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Role {
    /// Starts, watches and stops the others.
    Scheduler = 0,
    /// Brings pairs.
    Capture = 1,
    /// Pair to disparity.
    Stereo = 2,
    /// Disparity to road and regions.
    Road = 3,
    /// Regions to tracked obstacles and the alarm.
    Recognition = 4,
    /// Writes results to files; only where asked for.
    Writer = 5,
}

impl Role {
    /// All roles.
    pub const ALL: [Role; 6] =
        [Role::Scheduler, Role::Capture, Role::Stereo, Role::Road, Role::Recognition, Role::Writer];

    /// The stages that every frame passes, in order; a header holds one stamp for each.
    pub const STAGES: [Role; 4] = [Role::Capture, Role::Stereo, Role::Road, Role::Recognition];

    /// The word for it on the command line and in logs.
    pub fn name(self) -> &'static str {
        match self {
            Role::Scheduler => "scheduler",
            Role::Capture => "capture",
            Role::Stereo => "stereo",
            Role::Road => "road",
            Role::Recognition => "recognition",
            Role::Writer => "writer",
        }
    }

    /// The role of a raw number, as messages hold it.
    pub fn from_raw(raw: u8) -> Option<Role> {
        Role::ALL.into_iter().find(|role| *role as u8 == raw)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Role {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Role::ALL.into_iter().find(|role| role.name() == name).ok_or_else(|| {
            let names = Role::ALL.map(Role::name).join(", ");
            format!("\"{name}\" is no role: give one of {names}")
        })
    }
}
