//! A scene while it is generated, and its text.

use super::dice::Dice;
use super::occupancy::{Occupancy, STEP_S, Solid};
use crate::scene::bay::BayFile;
use crate::scene::boundary::EAVES_M;
use crate::scene::file::{BesideKind, ObjectKind, Weather};
use crate::scene::motion::Waypoints;
use crate::scene::strip::{Cover, Side, StripFile};

/// The space that our vehicle takes: behind the camera, ahead of it, and to either side, in metres. Wider than the strip
/// that counts as its path.
const OWN_M: (f64, f64, f64) = (3.0, 3.5, 1.25);

/// Deepest house, without its eaves, in metres.
const HOUSE_M: f64 = 9.0;

/// How an object moves.
#[derive(Clone, Debug)]
pub enum Motion {
    /// It stands.
    Still,
    /// Along the road and to the right, in m/s.
    Even(f64, f64),
    /// `[seconds, along, lateral]`.
    Path(Vec<[f64; 3]>),
    /// `[seconds, ahead of us, lateral]`.
    Ahead(Vec<[f64; 3]>),
}

/// An object.
#[derive(Clone, Debug)]
pub struct Thing {
    /// Its kind.
    pub kind: ObjectKind,
    /// Width, height and length, in metres.
    pub size_m: [f64; 3],
    /// Near side along the road and middle across it, in metres, where the motion does not give them.
    pub at: (f64, f64),
    /// Its motion.
    pub motion: Motion,
    /// Yaw to the right, in degrees.
    pub yaw_deg: f64,
    /// Mean grey value.
    pub grey: f64,
}

/// A row beside the road, of one piece or of many.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Its kind.
    pub kind: BesideKind,
    /// Side of the road.
    pub side: Side,
    /// Distance of its near side from the reference line, in metres.
    pub out_m: f64,
    /// Extent along the road, in metres.
    pub along: (f64, f64),
    /// Height, in metres.
    pub height_m: f64,
    /// Mean grey value.
    pub grey: f64,
}

/// A scene while it is generated.
#[derive(Debug)]
pub struct Draft {
    /// What it shows.
    pub title: String,
    seed: u64,
    /// Weather.
    pub weather: Weather,
    /// Length, in seconds.
    pub seconds: f64,
    /// Height in metres; pitch, sway in pitch and sway in roll in degrees.
    pub camera: [f64; 4],
    /// Own speed: `(seconds, m/s)`.
    pub speed: Vec<(f64, f64)>,
    /// Own lateral position: `(seconds, metres)`.
    pub lateral: Vec<(f64, f64)>,
    /// Edges of the asphalt, in metres.
    pub edges: (f64, f64),
    /// Solid and dashed lane markings, in metres.
    pub lines: (Vec<f64>, Vec<f64>),
    /// Texture of the asphalt, and wetness.
    pub asphalt: (f64, f64),
    /// Grade: `(along, percent)`.
    pub grade: Vec<(f64, f64)>,
    /// Curvature: `(along, 1/km)`.
    pub bend: Vec<(f64, f64)>,
    strips: Vec<StripFile>,
    bays: Vec<BayFile>,
    rows: Vec<(Row, f64)>,
    things: Vec<Thing>,
    space: Occupancy,
}

impl Draft {
    /// An empty scene.
    pub fn new(seed: u64) -> Self {
        Self {
            title: String::new(),
            seed,
            weather: Weather::Sunny,
            seconds: 16.0,
            camera: [1.25, 0.0, 0.1, 0.1],
            speed: vec![(0.0, 8.0)],
            lateral: vec![(0.0, 0.0)],
            edges: (-3.0, 3.0),
            lines: (Vec::new(), Vec::new()),
            asphalt: (1.0, 0.0),
            grade: vec![(0.0, 0.0)],
            bend: vec![(0.0, 0.0)],
            strips: Vec::new(),
            bays: Vec::new(),
            rows: Vec::new(),
            things: Vec::new(),
            space: Occupancy::default(),
        }
    }

    /// The seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Our position along the road at a time, in metres.
    pub fn along_m(&self, time_s: f64) -> f64 {
        line(&self.speed).integral(time_s)
    }

    /// Length of our drive, in metres.
    pub fn way_m(&self) -> f64 {
        self.along_m(self.seconds)
    }

    /// Our speed at a time, in m/s.
    pub fn speed_m_s(&self, time_s: f64) -> f64 {
        line(&self.speed).value(time_s)
    }

    /// Distance of the edge of the asphalt on a side from the reference line, in metres.
    pub fn edge(&self, side: Side) -> f64 {
        if side == Side::Left { -self.edges.0 } else { self.edges.1 }
    }

    /// Distance of the end of the strips so far on a side from the reference line, in metres.
    pub fn outer(&self, side: Side) -> f64 {
        let own = self.strips.iter().filter(|strip| strip.side == side);
        self.edge(side) + own.map(|strip| strip.width_m).sum::<f64>()
    }

    /// Adds a strip of ground with its step and its rise, and returns the distances of its near and its far edge.
    pub fn strip(
        &mut self,
        side: Side,
        width_m: f64,
        (step_m, rise_m): (f64, f64),
        cover: Cover,
    ) -> (f64, f64) {
        let inner = self.outer(side);
        let mut dice = Dice::new(self.seed, &format!("cover {}", self.strips.len()));
        let (least, most) = match cover {
            Cover::Lawn => (72.0, 125.0),
            Cover::Grass => (68.0, 112.0),
            Cover::Earth => (80.0, 125.0),
            Cover::Gravel => (110.0, 150.0),
            Cover::Pavement => (112.0, 155.0),
            Cover::Stone => (125.0, 175.0),
            Cover::Asphalt => (96.0, 96.0),
        };
        let grey = Some(dice.between(least, most));
        self.strips.push(StripFile { side, width_m, step_m, rise_m, cover, grey });
        (inner, inner + width_m)
    }

    /// Paints bays between two lateral positions.
    pub fn paint_bays(&mut self, side: Side, (inner, outer): (f64, f64), first_m: f64, spacing_m: f64) {
        let lateral_m = ordered(side.sign() * inner, side.sign() * outer);
        self.bays.push(BayFile { lateral_m, first_m, spacing_m });
    }

    /// Takes the space of our own vehicle; to be called once speed and lateral position are known.
    pub fn drive(&mut self) {
        let lateral = line(&self.lateral);
        let steps = self.times().map(|t| {
            let (along, across) = (self.along_m(t), lateral.smooth(t).0);
            Solid {
                along: (along - OWN_M.0, along + OWN_M.1),
                across: (across - OWN_M.2, across + OWN_M.2),
                up: (0.0, 2.0),
            }
        });
        let steps = steps.collect();
        self.space.add_moving(steps);
    }

    fn times(&self) -> impl Iterator<Item = f64> + use<> {
        let count = (self.seconds / STEP_S).ceil() as u32;
        (0..=count).map(|k| f64::from(k) * STEP_S)
    }

    /// Length along the reference line of a metre at a distance from it, inside the sharpest bend.
    fn tight(&self, out_m: f64) -> f64 {
        let bend = line(&self.bend).max_abs();
        1.0 / (1.0 - out_m * bend / 1000.0).max(0.2)
    }

    /// Adds a row of many pieces unless its space is taken.
    pub fn row(&mut self, row: Row) -> bool {
        let sign = row.side.sign();
        let depth = match row.kind {
            BesideKind::Hedge => 0.9,
            BesideKind::Bank => 6.0,
            BesideKind::Barrier => 0.6,
            _ => 0.45,
        };
        let part = Solid {
            along: row.along,
            across: ordered(sign * (row.out_m - 0.1), sign * (row.out_m + depth)),
            up: (0.0, 1.2 * row.height_m),
        };
        if row.along.1 - row.along.0 < 2.0 || !self.space.add_still(&[part]) {
            return false;
        }
        self.rows.push((row, 0.0));
        true
    }

    /// Adds one tree, post, lamp, sign, bush or house of a length unless its space is taken.
    pub fn single(&mut self, row: Row, length_m: f64) -> bool {
        let (sign, h) = (row.side.sign(), row.height_m);
        let tight = self.tight(row.out_m + HOUSE_M);
        // Positions along the road are those of the near side.
        let middle = row.along.0
            + match row.kind {
                BesideKind::Trees => 0.4 * h,
                BesideKind::Bushes => 0.6 * h,
                _ => 0.1,
            };
        let around = |out: f64, half: f64, up: (f64, f64)| Solid {
            along: (middle - half * tight, middle + half * tight),
            across: ordered(sign * (out - half), sign * (out + half)),
            up,
        };
        let out = row.out_m;
        let parts = match row.kind {
            BesideKind::Buildings => vec![Solid {
                along: (row.along.0 - EAVES_M, row.along.0 + (length_m + 2.0 * EAVES_M) * tight),
                across: ordered(sign * (out - EAVES_M), sign * (out + HOUSE_M + 2.0 * EAVES_M)),
                up: (0.0, h + 2.5),
            }],
            // The trunk, which stands anywhere below the crown's middle, and the crown.
            BesideKind::Trees => {
                vec![around(out, 0.15 * h, (0.0, h)), around(out, 0.46 * h, (0.3 * h, h))]
            }
            BesideKind::Bushes => vec![around(out + 0.5, 0.75 * h, (0.0, h))],
            BesideKind::Lamps => {
                // The position is the middle of its arm.
                let arm = Solid {
                    across: ordered(sign * (out - 1.1), sign * (out + 1.1)),
                    ..around(out, 0.3, (h - 0.2, h + 0.2))
                };
                vec![around(out + 0.9, 0.15, (0.0, h)), arm]
            }
            BesideKind::Signs => vec![around(out + 0.3, 0.35, (0.0, h))],
            _ => vec![around(out + 0.1, 0.15, (0.0, h))],
        };
        if !self.space.add_still(&parts) {
            return false;
        }
        self.rows.push((row, length_m));
        true
    }

    /// Adds an object unless its space is taken at any time.
    pub fn place(&mut self, thing: Thing) -> bool {
        let [width, height, length] = thing.size_m;
        let (sin, cos) = thing.yaw_deg.to_radians().sin_cos();
        let half = 0.5 * (width * cos.abs() + length * sin.abs());
        let long = width * sin.abs() + length * cos.abs();
        let solid = |(along, across): (f64, f64)| Solid {
            along: (along, along + long),
            across: (across - half, across + half),
            up: (0.0, height),
        };
        let is_free = match &thing.motion {
            Motion::Still if thing.kind == ObjectKind::Bridge => self.space.add_still(&bridge(&thing)),
            Motion::Still => self.space.add_still(&[solid(thing.at)]),
            moving => {
                let steps = self.times().map(|t| solid(self.at(moving, thing.at, t))).collect();
                self.space.add_moving(steps)
            }
        };
        if is_free {
            self.things.push(thing);
        }
        is_free
    }

    fn at(&self, motion: &Motion, from: (f64, f64), time_s: f64) -> (f64, f64) {
        let path = |points: &[[f64; 3]]| {
            let of = |k: usize| line(&points.iter().map(|p| (p[0], p[k])).collect::<Vec<_>>()).value(time_s);
            (of(1), of(2))
        };
        match motion {
            Motion::Still => from,
            Motion::Even(along, across) => (from.0 + along * time_s, from.1 + across * time_s),
            Motion::Path(points) => path(points),
            Motion::Ahead(points) => {
                let (ahead, lateral) = path(points);
                (self.along_m(time_s) + ahead, lateral)
            }
        }
    }

    /// The text of the scene file.
    pub fn text(&self) -> String {
        let mut out = Vec::new();
        let mut put = |text: String| out.push(text);
        put(format!("title = \"{}\"", self.title));
        put(format!("seconds = {}\nseed = {}", number(self.seconds), self.seed));
        put(format!("weather = \"{}\"", self.weather.name()));
        let [height, pitch, sway_pitch, sway_roll] = self.camera.map(number);
        put(format!("\n[camera]\nheight_m = {height}\npitch_deg = {pitch}"));
        put(format!("sway_pitch_deg = {sway_pitch}\nsway_roll_deg = {sway_roll}"));
        put(format!("\n[ego]\nspeed_m_s = {}\nlateral_m = {}", points(&self.speed), points(&self.lateral)));
        let (left, right) = (number(self.edges.0), number(self.edges.1));
        put(format!("\n[road]\nedges_m = [{left}, {right}]\nkerb_m = 0\npavement_m = 0"));
        put(format!("solid_m = {}\ndashed_m = {}", list(&self.lines.0), list(&self.lines.1)));
        put(format!("texture = {}\nwet = {}", number(self.asphalt.0), number(self.asphalt.1)));
        put(format!("grade_percent = {}\nbend_per_km = {}", points(&self.grade), points(&self.bend)));
        for strip in &self.strips {
            let name = if strip.side == Side::Left { "left" } else { "right" };
            let [width, step, rise] = [strip.width_m, strip.step_m, strip.rise_m].map(number);
            put(format!(
                "\n[[road.strip]]\nside = \"{name}\"\nwidth_m = {width}\nstep_m = {step}\nrise_m = {rise}"
            ));
            let cover = snake(&format!("{:?}", strip.cover));
            put(format!("cover = \"{cover}\"\ngrey = {}", number(strip.grey.unwrap_or(100.0))));
        }
        for bays in &self.bays {
            let (left, right) = (number(bays.lateral_m.0), number(bays.lateral_m.1));
            put(format!("\n[[road.bays]]\nlateral_m = [{left}, {right}]"));
            put(format!("first_m = {}\nspacing_m = {}", number(bays.first_m), number(bays.spacing_m)));
        }
        self.rows.iter().for_each(|(row, length_m)| put(row_text(row, *length_m)));
        self.things.iter().for_each(|thing| put(thing_text(thing)));
        out.push(String::new());
        out.join("\n")
    }
}

/// The parts of a bridge: the deck and both abutments.
fn bridge(thing: &Thing) -> [Solid; 3] {
    let [span, clearance, length] = thing.size_m;
    let (along, middle) = ((thing.at.0, thing.at.0 + length), thing.at.1);
    let half = span / 2.0;
    let part = |from: f64, to: f64, up: (f64, f64)| Solid { along, across: (middle + from, middle + to), up };
    [
        part(-half - 12.0, half + 12.0, (clearance, clearance + 2.5)),
        part(-half - 4.0, -half, (0.0, clearance)),
        part(half, half + 4.0, (0.0, clearance)),
    ]
}

fn row_text(row: &Row, length_m: f64) -> String {
    let (kind, (from, to)) = (snake(&format!("{:?}", row.kind)), row.along);
    let mut text = format!(
        "\n[[beside]]\nkind = \"{kind}\"\nlateral_m = {}\nfrom_m = {}\nto_m = {}\nheight_m = {}\ngrey = {}",
        number(row.side.sign() * row.out_m),
        number(from),
        number(to),
        number(row.height_m),
        number(row.grey),
    );
    if length_m > 0.0 {
        text += &format!("\nlength_m = {}", number(length_m));
    } else if to - from > 1.5 {
        // Pieces of about 4 m that end where the row ends.
        let spacing = (to - from) / ((to - from) / 4.0).round().max(1.0);
        text += &format!("\nspacing_m = {}", number(spacing + 1e-3));
    }
    text
}

fn thing_text(thing: &Thing) -> String {
    let kind = snake(&format!("{:?}", thing.kind));
    let [width, height, length] = thing.size_m.map(number);
    let (along, lateral) = (number(thing.at.0), number(thing.at.1));
    let place = match &thing.motion {
        Motion::Still => format!("along_m = {along}\nlateral_m = {lateral}"),
        Motion::Even(ahead, across) => format!(
            "along_m = {along}\nlateral_m = {lateral}\nspeed_m_s = {}\nacross_m_s = {}",
            number(*ahead),
            number(*across)
        ),
        Motion::Path(points) => format!("path = {}", triples(points)),
        Motion::Ahead(points) => format!("ahead = {}", triples(points)),
    };
    format!(
        "\n[[objects]]\nkind = \"{kind}\"\n{place}\nyaw_deg = {}\ngrey = {}\nsize_m = [{width}, {height}, {length}]",
        number(thing.yaw_deg),
        number(thing.grey)
    )
}

/// A function of place or time; the generator's points are valid.
fn line(points: &[(f64, f64)]) -> Waypoints {
    Waypoints::new(points.to_vec()).unwrap_or(Waypoints::constant(0.0))
}

fn ordered(a: f64, b: f64) -> (f64, f64) {
    (a.min(b), a.max(b))
}

/// A name in a file: words in lower case with underscores.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for (k, c) in name.chars().enumerate() {
        if k > 0 && c.is_uppercase() {
            out.push('_');
        }
        out.push(c.to_ascii_lowercase());
    }
    out
}

/// A number with at most three decimals.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

fn list(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", "))
}

fn points(points: &[(f64, f64)]) -> String {
    let all: Vec<String> = points.iter().map(|p| format!("[{}, {}]", number(p.0), number(p.1))).collect();
    format!("[{}]", all.join(", "))
}

fn triples(points: &[[f64; 3]]) -> String {
    format!("[{}]", points.iter().map(|p| list(p)).collect::<Vec<_>>().join(", "))
}
