//! The standard tests as numbers: each row is declared here once.

use crate::scene::file::ObjectKind;
use crate::scene::strip::Side;

/// What is hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A car.
    Car,
    /// An adult.
    Adult,
    /// A child.
    Child,
    /// A bicycle with its rider.
    Bicycle,
    /// A motorcycle with its rider.
    Motorcycle,
}

impl Target {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Adult => "adult",
            Self::Child => "child",
            Self::Bicycle => "bicycle",
            Self::Motorcycle => "motorcycle",
        }
    }

    /// Kind of the scene's object, and its width, height and length in metres: those of the public descriptions where they
    /// give them, else of the scenes' models.
    pub fn model(self) -> (ObjectKind, [f64; 3]) {
        match self {
            Self::Car => (ObjectKind::Car, [1.712, 1.46, 4.023]),
            Self::Adult => (ObjectKind::Pedestrian, [0.5, 1.8, 0.4]),
            Self::Child => (ObjectKind::Pedestrian, [0.35, 1.15, 0.3]),
            Self::Bicycle => (ObjectKind::Cyclist, [0.6, 1.75, 1.75]),
            Self::Motorcycle => (ObjectKind::Motorcyclist, [0.8, 1.75, 2.08]),
        }
    }

    /// Whether a person walks.
    pub fn walks(self) -> bool {
        matches!(self, Self::Adult | Self::Child)
    }
}

/// Distance to the vehicle ahead when it begins to brake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gap {
    /// In metres.
    Metres(f64),
    /// What we drive in this time, in seconds.
    Seconds(f64),
}

/// How the target moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It stands in our lane.
    Stands,
    /// It goes ahead of us at this speed, in km/h.
    Leads(f64),
    /// It drives ahead of us as fast as we do, and brakes to 2 km/h with this deceleration, in m/s².
    Brakes(Gap, f64),
    /// It crosses our path.
    Crosses {
        /// Side from which it comes.
        from: Side,
        /// Speed, in km/h.
        km_h: f64,
        /// Distance aside of our middle at which it stands before, in metres; infinite if it was always moving.
        start_m: f64,
        /// Whether parked cars hide it, or a wall what is higher than these.
        is_hidden: bool,
    },
    /// It comes towards us at this speed, in km/h: in our lane, or, where we turn, in its own.
    Comes(f64),
}

/// Where it is hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// This share of our width overlaps with it, in per cent, on the right where positive; 100: centred.
    Overlap(i32),
    /// Its middle meets our front at this share of our width, in per cent: from the left, or from the side from which it
    /// comes.
    At(i32),
}

impl Place {
    /// The number.
    pub fn percent(self) -> i32 {
        match self {
            Self::Overlap(percent) | Self::At(percent) => percent,
        }
    }
}

/// What a row asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duty {
    /// A warning in time and an alarm in time.
    Both,
    /// A warning in time.
    Warning,
}

/// How a row becomes a near miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Miss {
    /// The target keeps beside our path with this clearance, in metres.
    Beside(f64),
    /// It stops at the kerb, or before our lane, 3 s before we pass.
    Stops,
    /// It has left our path when we arrive, by this clearance, in metres.
    HasPassed(f64),
    /// It has left our path by this time before we cross its own, in seconds.
    Earlier(f64),
    /// It stays in its own lane.
    OwnLane,
    /// It is parked beside the outer edge of a bend.
    InBend,
}

impl Miss {
    /// Its name.
    pub fn name(self) -> String {
        match self {
            Self::Beside(m) => format!("beside by {m:.1} m"),
            Self::Stops => "stops before".into(),
            Self::HasPassed(m) => format!("has passed by {m:.1} m"),
            Self::Earlier(s) => format!("has passed {s:.0} s before"),
            Self::OwnLane => "in its lane".into(),
            Self::InBend => "parked in a bend".into(),
        }
    }
}

/// A test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Name in the protocol.
    pub name: &'static str,
    /// What distinguishes it from other rows of that name; may be empty.
    pub variant: &'static str,
    /// What happens.
    pub title: &'static str,
    /// Protocols that have it.
    pub years: &'static [u16],
    /// Whether it belongs to the extended range.
    pub is_extended: bool,
    /// What is hit.
    pub target: Target,
    /// How that moves.
    pub motion: Motion,
    /// Our turn: to which side. Its radius depends on the speed: [`turn_radius_m`].
    pub turn: Option<Side>,
    /// Our speeds, in km/h.
    pub own_km_h: &'static [f64],
    /// Where it is hit; the first is the nominal one.
    pub places: &'static [Place],
    /// Whether it is also driven at night.
    pub at_night: bool,
    /// What it asks for.
    pub duty: Duty,
}

impl Row {
    /// Name and variant.
    pub fn label(&self) -> String {
        if self.variant.is_empty() { self.name.into() } else { format!("{} {}", self.name, self.variant) }
    }

    /// Its near misses.
    pub fn misses(&self) -> &'static [Miss] {
        match (self.motion, self.target) {
            (Motion::Stands, Target::Car) => &[Miss::Beside(0.5), Miss::Beside(1.0), Miss::InBend],
            (Motion::Comes(_), _) if self.turn.is_some() => &[Miss::Earlier(1.0)],
            (Motion::Comes(_), _) => &[Miss::OwnLane, Miss::Beside(1.0)],
            (Motion::Crosses { .. }, _) => &[Miss::Stops, Miss::HasPassed(0.5), Miss::HasPassed(1.0)],
            (_, Target::Bicycle) => &[Miss::Beside(1.0), Miss::Beside(1.5)],
            _ => &[Miss::Beside(0.5), Miss::Beside(1.0)],
        }
    }

    /// Whether the time to collision of its warning is a protocol's number: it is for the rows that test the warning alone.
    pub fn is_warning_quoted(&self) -> bool {
        self.duty == Duty::Warning
    }
}

/// Radius of our turn at a speed, in metres: those of the protocol for turns across the path of an oncoming vehicle.
pub fn turn_radius_m(own_km_h: f64) -> f64 {
    let (slow, fast) = ((10.0, 9.0), (20.0, 14.75));
    slow.1 + (own_km_h - slow.0) / (fast.0 - slow.0) * (fast.1 - slow.1)
}

const BOTH: &[u16] = &[2023, 2026];
const OLD: &[u16] = &[2023];
const NEW: &[u16] = &[2026];

const OVERLAPS: &[Place] =
    &[Place::Overlap(100), Place::Overlap(50), Place::Overlap(-50), Place::Overlap(75), Place::Overlap(-75)];
const ACROSS: &[Place] = &[Place::At(50), Place::At(25), Place::At(75), Place::At(0), Place::At(100)];
const BEYOND: &[Place] = &[Place::At(-25), Place::At(125)];
const QUARTERS: &[Place] = &[Place::At(50), Place::At(25), Place::At(75)];
const MIDDLE: &[Place] = &[Place::At(50)];
const QUARTER: &[Place] = &[Place::At(25)];

const BY_5_TO_50: &[f64] = &[10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0];
const BY_5_FROM_55: &[f64] = &[55.0, 60.0, 65.0, 70.0, 75.0, 80.0];
const TO_50: &[f64] = &[10.0, 20.0, 30.0, 40.0, 50.0];
const TO_60: &[f64] = &[10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
const TO_80: &[f64] = &[30.0, 40.0, 50.0, 60.0, 70.0, 80.0];
const FROM_50: &[f64] = &[50.0, 60.0, 70.0, 80.0];
const FROM_60: &[f64] = &[60.0, 70.0, 80.0];
const TURNING: &[f64] = &[10.0, 15.0, 20.0];

/// What the rows below do not say.
const BASE: Row = Row {
    name: "",
    variant: "",
    title: "",
    years: BOTH,
    is_extended: false,
    target: Target::Car,
    motion: Motion::Stands,
    turn: None,
    own_km_h: TO_60,
    places: MIDDLE,
    at_night: false,
    duty: Duty::Both,
};

const CCRS: Row = Row { name: "CCRs", title: "car that stands", ..BASE };
const CCRS_WARNING: Row =
    Row { name: "CCRs-FCW", title: "car that stands, warning only", duty: Duty::Warning, ..BASE };
const CCRM: Row =
    Row { name: "CCRm", title: "slower car", motion: Motion::Leads(20.0), own_km_h: TO_80, ..BASE };
const CCRB: Row = Row { name: "CCRb", title: "car that brakes", own_km_h: &[50.0], ..BASE };
const CCFHOS: Row = Row {
    name: "CCFhos",
    title: "oncoming car in our lane",
    motion: Motion::Comes(50.0),
    own_km_h: TO_80,
    places: &[Place::Overlap(50), Place::Overlap(25), Place::Overlap(75)],
    ..BASE
};
const CPFA: Row = Row {
    name: "CPFA",
    title: "adult runs from the far side",
    target: Target::Adult,
    motion: crossing(Side::Left, 8.0, 6.0),
    at_night: true,
    ..BASE
};
const CPLA: Row = Row {
    name: "CPLA",
    title: "adult walks along",
    target: Target::Adult,
    motion: Motion::Leads(5.0),
    own_km_h: &[20.0, 30.0, 40.0, 50.0, 60.0],
    at_night: true,
    ..BASE
};
const CPTA: Row = Row {
    name: "CPTA",
    title: "adult crosses where we turn",
    target: Target::Adult,
    motion: crossing(Side::Right, 5.0, 4.0),
    own_km_h: TURNING,
    ..BASE
};
const CBNA: Row = Row {
    name: "CBNA",
    title: "bicycle from the near side",
    target: Target::Bicycle,
    motion: crossing(Side::Right, 15.0, f64::INFINITY),
    ..BASE
};
const CBFA: Row = Row {
    name: "CBFA",
    title: "bicycle from the far side",
    target: Target::Bicycle,
    motion: crossing(Side::Left, 20.0, f64::INFINITY),
    ..BASE
};
const CBLA: Row = Row {
    name: "CBLA",
    title: "bicycle rides along",
    target: Target::Bicycle,
    motion: Motion::Leads(15.0),
    own_km_h: &[25.0, 30.0, 40.0, 50.0, 60.0],
    ..BASE
};
const CMRS: Row = Row {
    name: "CMRs",
    title: "motorcycle that stands",
    target: Target::Motorcycle,
    own_km_h: TO_50,
    places: QUARTERS,
    ..BASE
};
const CCFTAP: Row = Row {
    name: "CCFtap",
    title: "we turn across the path of an oncoming car",
    turn: Some(Side::Left),
    own_km_h: TURNING,
    places: MIDDLE,
    ..CCFHOS
};
const CMFTAP: Row = Row {
    name: "CMFtap",
    title: "we turn across the path of an oncoming motorcycle",
    target: Target::Motorcycle,
    ..CCFTAP
};
const CCCSCP: Row = Row { name: "CCCscp", title: "car crosses", own_km_h: &[20.0, 40.0, 60.0], ..BASE };
const CMCSCP: Row = Row { name: "CMCscp", title: "motorcycle crosses", target: Target::Motorcycle, ..CCCSCP };

const fn crossing(from: Side, km_h: f64, start_m: f64) -> Motion {
    Motion::Crosses { from, km_h, start_m, is_hidden: false }
}

const fn hidden(km_h: f64, start_m: f64) -> Motion {
    Motion::Crosses { from: Side::Right, km_h, start_m, is_hidden: true }
}

const fn brakes(variant: &'static str, gap_m: f64, m_s2: f64) -> Row {
    Row { variant, years: OLD, motion: Motion::Brakes(Gap::Metres(gap_m), m_s2), ..CCRB }
}

const fn fast(variant: &'static str, own_km_h: &'static [f64], target_km_h: f64) -> Row {
    Row { variant, years: NEW, is_extended: true, motion: Motion::Leads(target_km_h), own_km_h, ..CCRM }
}

/// All tests.
pub const ROWS: &[Row] = &[
    Row { years: OLD, own_km_h: BY_5_TO_50, places: OVERLAPS, ..CCRS },
    Row { years: NEW, own_km_h: TO_50, places: ACROSS, ..CCRS },
    Row { variant: "edge", years: NEW, is_extended: true, own_km_h: TO_50, places: BEYOND, ..CCRS },
    Row { years: OLD, own_km_h: BY_5_FROM_55, places: OVERLAPS, ..CCRS_WARNING },
    Row { years: NEW, own_km_h: FROM_60, places: ACROSS, ..CCRS_WARNING },
    Row { years: OLD, places: OVERLAPS, ..CCRM },
    Row { years: NEW, places: ACROSS, ..CCRM },
    fast("30 km/h", &[90.0], 30.0),
    fast("40 km/h", &[100.0], 40.0),
    fast("50 km/h", &[110.0], 50.0),
    fast("60 km/h", &[120.0], 60.0),
    fast("70 km/h", &[130.0], 70.0),
    brakes("12 m, -2", 12.0, 2.0),
    brakes("12 m, -6", 12.0, 6.0),
    brakes("40 m, -2", 40.0, 2.0),
    brakes("40 m, -6", 40.0, 6.0),
    Row {
        variant: "1 s, -4",
        years: NEW,
        own_km_h: TO_80,
        motion: Motion::Brakes(Gap::Seconds(1.0), 4.0),
        places: ACROSS,
        ..CCRB
    },
    Row {
        name: "CPNA",
        title: "adult walks from the near side",
        target: Target::Adult,
        motion: crossing(Side::Right, 5.0, 4.0),
        places: QUARTERS,
        at_night: true,
        ..BASE
    },
    CPFA,
    Row {
        name: "CPNCO",
        title: "child from behind parked cars",
        target: Target::Child,
        motion: hidden(5.0, 3.2),
        at_night: true,
        ..BASE
    },
    CPLA,
    Row {
        name: "CPLA-FCW",
        title: "adult walks along, warning only",
        own_km_h: FROM_50,
        places: QUARTER,
        duty: Duty::Warning,
        ..CPLA
    },
    Row { variant: "right", turn: Some(Side::Right), ..CPTA },
    Row { variant: "left", turn: Some(Side::Left), ..CPTA },
    Row { years: OLD, ..CBNA },
    Row { years: NEW, places: &[Place::At(50), Place::At(75)], ..CBNA },
    Row { years: OLD, ..CBFA },
    Row { years: NEW, places: &[Place::At(50), Place::At(25)], ..CBFA },
    Row { name: "CBNAO", title: "bicycle from behind a wall", motion: hidden(10.0, f64::INFINITY), ..CBNA },
    CBLA,
    Row {
        name: "CBLA-FCW",
        title: "bicycle rides along, warning only",
        motion: Motion::Leads(20.0),
        own_km_h: FROM_50,
        places: QUARTER,
        duty: Duty::Warning,
        ..CBLA
    },
    CMRS,
    Row {
        name: "CMRs-FCW",
        title: "motorcycle that stands, warning only",
        own_km_h: FROM_60,
        duty: Duty::Warning,
        ..CMRS
    },
    Row {
        name: "CMRb",
        variant: "1 s, -4",
        title: "motorcycle that brakes",
        own_km_h: TO_80,
        motion: Motion::Brakes(Gap::Seconds(1.0), 4.0),
        ..CMRS
    },
    Row { variant: "50 km/h", ..CCFHOS },
    Row { variant: "70 km/h", motion: Motion::Comes(70.0), ..CCFHOS },
    Row { variant: "30 km/h", motion: Motion::Comes(30.0), ..CCFTAP },
    Row { variant: "45 km/h", motion: Motion::Comes(45.0), ..CCFTAP },
    Row { variant: "60 km/h", motion: Motion::Comes(60.0), ..CCFTAP },
    Row { variant: "30 km/h", motion: Motion::Comes(30.0), ..CMFTAP },
    Row { variant: "45 km/h", motion: Motion::Comes(45.0), ..CMFTAP },
    Row { variant: "60 km/h", motion: Motion::Comes(60.0), ..CMFTAP },
    Row { variant: "left 20 km/h", motion: crossing(Side::Left, 20.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "left 40 km/h", motion: crossing(Side::Left, 40.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "left 60 km/h", motion: crossing(Side::Left, 60.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "right 20 km/h", motion: crossing(Side::Right, 20.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "right 40 km/h", motion: crossing(Side::Right, 40.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "right 60 km/h", motion: crossing(Side::Right, 60.0, f64::INFINITY), ..CCCSCP },
    Row { variant: "left 20 km/h", motion: crossing(Side::Left, 20.0, f64::INFINITY), ..CMCSCP },
    Row { variant: "left 40 km/h", motion: crossing(Side::Left, 40.0, f64::INFINITY), ..CMCSCP },
];
