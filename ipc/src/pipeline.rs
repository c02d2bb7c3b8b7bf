//! The pipeline, declared once: the services that carry messages, and the processes that read and write them.
//!
//! Everything that depends on the list of stages derives from the two tables below: [`Role`] and [`Kind`], the
//! stamps of a header ([`PATH`]), the ports that a stage opens, supervision, cores and priorities, the credit of
//! lock-step, the in-process run, reports, status, dashboard, viewer, metrics, recordings and the soak test.
//! `daemon/src/stages/mod.rs` names the constructor of each stage. CONTRIBUTING.md shows how a stage is added.

use std::fmt;
use std::str::FromStr;

/// Version of the layout of all messages: increased whenever one of them, or a table below, changes.
pub const VERSION: u16 = 12;

/// One service. Every service keeps the newest messages: a full buffer drops its oldest message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceSpec {
    /// The message that it carries.
    pub kind: Kind,
    /// Its name.
    pub name: &'static str,
    /// Whether its messages belong to a frame: the header then holds a valid image size.
    pub carries_frame: bool,
    /// Maximum number of simultaneous publishers: at least one more than the processes that publish, because the port of a
    /// dead process stays until it is swept.
    pub publishers: usize,
    /// Maximum number of simultaneous subscribers: the daemon's processes and external readers.
    pub subscribers: usize,
    /// Capacity of the buffer of one subscriber, in messages.
    pub buffer: usize,
    /// Maximum number of messages that one subscriber may borrow at a time.
    pub borrowed: usize,
    /// Number of past messages that a new subscriber receives.
    pub history: usize,
}

/// When a process is started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Starts {
    /// It is the scheduler, which starts the others.
    First,
    /// With every run.
    Always,
    /// Only when a command requests its output.
    OnRequest,
}

/// Where a process runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Core {
    /// On the core that the key `cores.<name>` gives; this is its default.
    Own(u16),
    /// On the core of another process.
    With(Role),
}

/// One process of the daemon. Everything that this table does not declare is the same for all stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessSpec {
    /// Its role.
    pub role: Role,
    /// Its name on the command line, in logs, in the status and in configuration keys.
    pub name: &'static str,
    /// When it is started.
    pub starts: Starts,
    /// The service whose frames it reads; `None` for the source and the scheduler.
    pub input: Option<&'static ServiceSpec>,
    /// The service to which it publishes frames; `None` where results leave the daemon.
    pub output: Option<&'static ServiceSpec>,
    /// Its core.
    pub core: Core,
    /// Default of the key `realtime.priority_<name>`, a SCHED_FIFO priority from 10 to 55; `None` for a process
    /// that never gets a real-time priority.
    pub priority: Option<u16>,
    /// Deadline of its first report, in milliseconds; `None` = `supervision.startup_deadline_ms`.
    pub startup_deadline_ms: Option<u32>,
    /// Longest time between two reports, after which it is killed, in milliseconds;
    /// `None` = `supervision.liveness_deadline_ms`.
    pub liveness_deadline_ms: Option<u32>,
    /// Tables of the configuration whose keys restart it at a reload. A key that more stages read says so itself.
    pub config_tables: &'static [&'static str],
}

macro_rules! services {
    ($($(#[$doc:meta])* $constant:ident = $kind:ident ($number:literal) { $($field:ident: $value:expr,)* } )*) => {
        /// The kind of a message, as its header holds it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u16)]
        pub enum Kind {
            $($(#[$doc])* $kind = $number,)*
        }

        impl Kind {
            /// The service that carries messages of this kind.
            pub const fn service(self) -> &'static ServiceSpec {
                match self { $(Self::$kind => &$constant,)* }
            }
        }

        $($(#[$doc])* pub const $constant: ServiceSpec = ServiceSpec { kind: Kind::$kind, $($field: $value,)* ..SERVICE_DEFAULTS };)*

        /// All services.
        pub const SERVICES: &[ServiceSpec] = &[$($constant),*];
    };
}

macro_rules! processes {
    ($($(#[$doc:meta])* $role:ident = $number:literal { $($field:ident: $value:expr,)* } )*) => {
        /// What a process of the daemon does.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Role {
            $($(#[$doc])* $role = $number,)*
        }

        /// All processes, indexed by the number of the role.
        pub const PROCESSES: &[ProcessSpec] = &[$(ProcessSpec { role: Role::$role, $($field: $value,)* ..PROCESS_DEFAULTS }),*];
    };
}

/// Subscribers reserved for external readers: two viewers and a recorder. Unused ones take no memory: pages of a
/// pool that are never written stay unallocated.
const READERS: usize = 3;

const SERVICE_DEFAULTS: ServiceSpec = ServiceSpec {
    kind: Kind::Pair,
    name: "",
    carries_frame: true,
    publishers: 2,
    subscribers: 1,
    buffer: 1,
    borrowed: 1,
    history: 0,
};

const PROCESS_DEFAULTS: ProcessSpec = ProcessSpec {
    role: Role::Scheduler,
    name: "",
    starts: Starts::Always,
    input: None,
    output: None,
    core: Core::With(Role::Scheduler),
    priority: None,
    startup_deadline_ms: None,
    liveness_deadline_ms: None,
    config_tables: &[],
};

services! {
    /// Two rectified grey images: capture → stereo, writer or `record`, `calibrate --live`.
    PAIR = Pair(1) { name: "pair", subscribers: 3, }
    /// Left image, disparity and confidence: stereo → road, writer, readers.
    DEPTH = Depth(2) { name: "depth", subscribers: 3 + READERS, }
    /// Road model, regions and their crops: road → recognition, writer, readers.
    REGIONS = Regions(3) { name: "regions", subscribers: 3 + READERS, }
    /// Tracked obstacles and the alarm: recognition → scheduler, writer, vehicle, readers. The scheduler publishes
    /// here, too, to withdraw the last result of a stage that is dead or silent. A new subscriber may therefore
    /// receive two messages from the history; the one that was issued later is valid
    /// ([`crate::obstacles::Newest`]).
    OBSTACLES = Obstacles(4) { name: "obstacles", publishers: 3, subscribers: 8 + READERS, history: 1, }
    /// State of a stage: every stage → scheduler, soak.
    REPORT = Report(5) { name: "report", carries_frame: false, publishers: 12, subscribers: 2, buffer: 64, }
    /// Rate, credit and modes of the source: scheduler → capture.
    COMMAND = Command(6) { name: "command", carries_frame: false, subscribers: 2, history: 1, }
    /// State of the daemon: scheduler → all readers.
    STATUS = Status(7) { name: "status", carries_frame: false, subscribers: 8 + READERS, history: 1, }
}

processes! {
    /// Starts, supervises and stops the others.
    Scheduler = 0 {
        name: "scheduler",
        starts: Starts::First,
        core: Core::Own(0),
        priority: Some(55),
    }
    /// Publishes the pairs of the source.
    Capture = 1 {
        name: "capture",
        output: Some(&PAIR),
        core: Core::Own(0),
        priority: Some(50),
    }
    /// Pair to disparity.
    Stereo = 2 {
        name: "stereo",
        input: Some(&PAIR),
        output: Some(&DEPTH),
        core: Core::Own(1),
        priority: Some(20),
        config_tables: &["stereo", "calibration"],
    }
    /// Disparity to road and regions.
    Road = 3 {
        name: "road",
        input: Some(&DEPTH),
        output: Some(&REGIONS),
        core: Core::Own(2),
        priority: Some(30),
        config_tables: &["road", "regions", "tracking", "motion"],
    }
    /// Regions to tracked obstacles and the alarm.
    Recognition = 4 {
        name: "recognition",
        input: Some(&REGIONS),
        output: Some(&OBSTACLES),
        core: Core::Own(3),
        priority: Some(40),
        config_tables: &["recognition", "alarm"],
    }
    /// Writes results to files.
    Writer = 5 {
        name: "writer",
        starts: Starts::OnRequest,
        input: Some(&OBSTACLES),
    }
}

/// The service whose messages are the daemon's results.
pub const RESULTS: ServiceSpec = OBSTACLES;

/// The stages that a frame passes from the source to the result, in order. A header holds one stamp for each.
pub const PATH: [Role; PATH_LENGTH] = path();

/// Number of stages from the source to the result.
pub const PATH_LENGTH: usize = {
    let (mut length, mut stage) = (1, producer(RESULTS.kind));
    while let Some(input) = stage.input {
        stage = producer(input.kind);
        length += 1;
    }
    length
};

/// The stage that publishes messages of a kind.
const fn producer(kind: Kind) -> &'static ProcessSpec {
    let mut i = 0;
    while i < PROCESSES.len() {
        if let Some(output) = PROCESSES[i].output
            && output.kind as u16 == kind as u16
        {
            return &PROCESSES[i];
        }
        i += 1;
    }
    panic!("a stage reads a service to which no stage publishes")
}

const fn path() -> [Role; PATH_LENGTH] {
    let mut stage = producer(RESULTS.kind);
    let mut path = [stage.role; PATH_LENGTH];
    let mut place = PATH_LENGTH;
    while let Some(input) = stage.input {
        stage = producer(input.kind);
        place -= 1;
        path[place - 1] = stage.role;
    }
    path
}

const fn starting(starts: Starts) -> usize {
    let (mut count, mut i) = (0, 0);
    while i < PROCESSES.len() {
        count += (PROCESSES[i].starts as u8 == starts as u8) as usize;
        i += 1;
    }
    count
}

const STAGE_COUNT: usize = starting(Starts::Always);

impl Role {
    /// Number of processes.
    pub const COUNT: usize = PROCESSES.len();

    /// All roles, indexed by their numbers.
    pub const ALL: [Role; Self::COUNT] = {
        let mut all = [Role::Scheduler; Self::COUNT];
        let mut i = 0;
        while i < all.len() {
            assert!(PROCESSES[i].role as usize == i, "the table is ordered by the numbers of the roles");
            all[i] = PROCESSES[i].role;
            i += 1;
        }
        all
    };

    /// The stages that start with every run.
    pub const STAGES: [Role; STAGE_COUNT] = {
        let mut stages = [Role::Scheduler; STAGE_COUNT];
        let (mut count, mut i) = (0, 0);
        while i < PROCESSES.len() {
            if matches!(PROCESSES[i].starts, Starts::Always) {
                stages[count] = PROCESSES[i].role;
                count += 1;
            }
            i += 1;
        }
        stages
    };

    /// Names of [`Self::STAGES`].
    pub const STAGE_NAMES: [&str; STAGE_COUNT] = {
        let mut names = [""; STAGE_COUNT];
        let mut i = 0;
        while i < STAGE_COUNT {
            names[i] = Self::STAGES[i].name();
            i += 1;
        }
        names
    };

    /// The stage where frames begin.
    pub const SOURCE: Role = PATH[0];

    /// The stage where results come out.
    pub const LAST: Role = PATH[PATH_LENGTH - 1];

    /// Its entry in the table.
    pub const fn spec(self) -> &'static ProcessSpec {
        &PROCESSES[self as usize]
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        self.spec().name
    }

    /// Its index in [`PATH`]; `None` if frames do not pass it.
    pub fn place(self) -> Option<usize> {
        PATH.iter().position(|&role| role == self)
    }

    /// Whether a frame counts as finished only after this process has finished it: the last stage of [`PATH`], and
    /// every process outside [`PATH`] except the scheduler.
    pub fn finishes_frames(self) -> bool {
        self == Self::LAST || (self != Self::Scheduler && self.place().is_none())
    }

    /// The role of a raw number, as messages hold it.
    pub fn from_raw(raw: u8) -> Option<Role> {
        Self::ALL.get(usize::from(raw)).copied()
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
            format!("unknown role \"{name}\": expected one of {names}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_passes_the_stages_from_the_source_to_the_result() {
        assert_eq!(PATH.map(Role::name), ["capture", "stereo", "road", "recognition"]);
        assert_eq!((Role::SOURCE, Role::LAST), (Role::Capture, Role::Recognition));
        assert_eq!(Role::STAGES, PATH, "every stage is on the path of a frame");
        let finishing: Vec<Role> = Role::ALL.into_iter().filter(|r| r.finishes_frames()).collect();
        assert_eq!(finishing, [Role::Recognition, Role::Writer]);
    }

    #[test]
    fn names_numbers_and_kinds_are_unique() {
        for (i, a) in SERVICES.iter().enumerate() {
            assert_eq!(a.kind.service(), a);
            for b in &SERVICES[..i] {
                assert!(a.name != b.name && a.kind != b.kind);
            }
        }
        for (i, a) in PROCESSES.iter().enumerate() {
            assert_eq!(Role::from_raw(a.role as u8), Some(a.role));
            assert_eq!(a.name.parse(), Ok(a.role));
            for b in &PROCESSES[..i] {
                assert!(a.name != b.name);
            }
        }
        assert!("walls".parse::<Role>().is_err() && Role::from_raw(Role::COUNT as u8).is_none());
    }

    #[test]
    fn priorities_finish_a_frame_before_the_next_begins() {
        // On a shared core, later stages preempt earlier ones, and the scheduler can kill a stage that spins.
        let priority = |role: Role| role.spec().priority.expect("a real-time process");
        assert!(PATH[1..].windows(2).all(|pair| priority(pair[0]) < priority(pair[1])));
        assert!(PROCESSES.iter().filter_map(|p| p.priority).all(|p| (10..=55).contains(&p)));
        assert!(Role::STAGES.into_iter().all(|role| priority(role) < priority(Role::Scheduler)));
    }
}
