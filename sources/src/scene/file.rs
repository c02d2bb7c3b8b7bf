//! Scene files: what a TOML file may say, and what it must not.

use super::motion::{Path, Waypoints};
use super::sensor::Sensor;
use perception::rig::{Rig, RigError};
use serde::{Deserialize, Deserializer, de::Error};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use thiserror::Error;

/// A scene as its file describes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// What it shows, in a line.
    pub title: String,
    /// Length in seconds.
    #[serde(deserialize_with = "duration_s")]
    pub seconds: f64,
    /// Pairs a second.
    #[serde(default = "default_fps", deserialize_with = "rate_hz")]
    pub fps: f64,
    /// Whether it starts again at its end, and never ends.
    #[serde(default)]
    pub repeats: bool,
    /// Seed of textures, noise, rain and snow.
    #[serde(default)]
    pub seed: u64,
    /// Weather and light.
    #[serde(default)]
    pub weather: Weather,
    /// The cameras.
    #[serde(default)]
    pub camera: CameraFile,
    /// The vehicle's own motion.
    #[serde(default)]
    pub ego: EgoFile,
    /// The road.
    #[serde(default)]
    pub road: RoadFile,
    /// Rows of things beside the road.
    #[serde(default)]
    pub beside: Vec<BesideFile>,
    /// Single things, still or moving.
    #[serde(default)]
    pub objects: Vec<ObjectFile>,
}

/// Weather and light, as in the paper's table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weather {
    /// Bright sun from behind.
    #[default]
    Sunny,
    /// Wet road, thin streaks, few drops on the lenses.
    LightRain,
    /// Streaks, spray, mirrors on the road, many drops on the lenses.
    HeavyRain,
    /// The vehicle's lamps, street lamps, much noise.
    Night,
    /// Flakes, ground covered.
    Snow,
    /// Low sun ahead: glare, saturation, dark sides.
    Backlight,
    /// No sun, no shadows, dry.
    Overcast,
}

impl Weather {
    /// All of them; the paper's six first, in its order.
    pub const ALL: [Self; 7] = [
        Self::Sunny,
        Self::LightRain,
        Self::HeavyRain,
        Self::Night,
        Self::Snow,
        Self::Backlight,
        Self::Overcast,
    ];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sunny => "sunny",
            Self::LightRain => "light_rain",
            Self::HeavyRain => "heavy_rain",
            Self::Night => "night",
            Self::Snow => "snow",
            Self::Backlight => "backlight",
            Self::Overcast => "overcast",
        }
    }

    /// The weather of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|weather| weather.name() == name)
    }
}

/// Rigs that scenes can name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NamedRig {
    /// The paper's: 640 × 480 px, 120 mm, 879 px of focal length.
    #[default]
    Paper,
    /// KITTI's grey cameras: 1242 × 375 px, 0.54 m, 721 px of focal length.
    Kitti,
}

impl NamedRig {
    /// Rig, image size and height above the road.
    pub fn values(self) -> (Rig, (usize, usize), f64) {
        match self {
            Self::Paper => {
                (Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 }, (640, 480), 1.25)
            }
            Self::Kitti => {
                (Rig { focal_px: 721.5, baseline_m: 0.54, cx_px: 609.6, cy_px: 172.9 }, (1242, 375), 1.65)
            }
        }
    }
}

/// The cameras: a named rig, and what differs from it.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    /// The rig that the rest is taken from.
    #[serde(default)]
    pub rig: NamedRig,
    /// Focal length in pixels.
    pub focal_px: Option<f64>,
    /// Distance of the cameras.
    pub baseline_m: Option<f64>,
    /// Column of the principal point.
    pub cx_px: Option<f64>,
    /// Row of the principal point.
    pub cy_px: Option<f64>,
    /// Image width.
    pub width_px: Option<u16>,
    /// Image height.
    pub height_px: Option<u16>,
    /// Height above the road.
    #[serde(default, deserialize_with = "camera_height_m")]
    pub height_m: Option<f64>,
    /// Nose down, in degrees; a number or a list of `[seconds, degrees]`.
    pub pitch_deg: Option<Waypoints>,
    /// Rolled clockwise, in degrees; a number or a list of `[seconds, degrees]`.
    pub roll_deg: Option<Waypoints>,
    /// How far the body sways in pitch, in degrees.
    #[serde(default, deserialize_with = "angle_deg")]
    pub sway_pitch_deg: f64,
    /// How far the body sways in roll, in degrees.
    #[serde(default, deserialize_with = "angle_deg")]
    pub sway_roll_deg: f64,
    /// How far the right camera's nose is turned down against the left one's, as when a mount gives way,
    /// in degrees; a number or a list of `[seconds, degrees]`. Truth and rig do not know.
    pub right_pitch_deg: Option<Waypoints>,
    /// Left sensor, in place of the weather's.
    pub left: Option<Sensor>,
    /// Right sensor, in place of the weather's.
    pub right: Option<Sensor>,
}

/// The vehicle's own motion.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EgoFile {
    /// Speed: a number or a list of `[seconds, m/s]`.
    pub speed_m_s: Waypoints,
    /// Place across the road: a number or a list of `[seconds, metres]`.
    pub lateral_m: Waypoints,
    /// Where it starts along the road.
    pub along_m: f64,
}

impl Default for EgoFile {
    fn default() -> Self {
        Self { speed_m_s: Waypoints::constant(0.0), lateral_m: Waypoints::constant(0.0), along_m: 0.0 }
    }
}

/// The road. Its reference line is where lateral is 0.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RoadFile {
    /// Left and right edge of the asphalt.
    #[serde(deserialize_with = "edges_m")]
    pub edges_m: (f64, f64),
    /// Height of the kerbs; 0 has none.
    #[serde(deserialize_with = "kerb_m")]
    pub kerb_m: f64,
    /// Width of the pavement beyond the kerbs.
    #[serde(deserialize_with = "width_m")]
    pub pavement_m: f64,
    /// Painted lines that do not end.
    pub solid_m: Vec<f64>,
    /// Dashed lines.
    pub dashed_m: Vec<f64>,
    /// Strength of the asphalt's texture, 0 to 1.5.
    #[serde(deserialize_with = "strength")]
    pub texture: f64,
    /// How wet the ground is, 0 to 1; rain wets it anyway.
    #[serde(deserialize_with = "share")]
    pub wet: f64,
    /// Rise in percent; a number or a list of `[along, percent]`.
    pub grade_percent: Waypoints,
    /// Bend to the right, 1 ÷ radius in km; a number or a list of `[along, 1/km]`.
    pub bend_per_km: Waypoints,
}

impl Default for RoadFile {
    fn default() -> Self {
        Self {
            edges_m: (-5.25, 5.25),
            kerb_m: 0.12,
            pavement_m: 2.5,
            solid_m: vec![-5.0, 5.0],
            dashed_m: vec![-1.75, 1.75],
            texture: 1.0,
            wet: 0.0,
            grade_percent: Waypoints::constant(0.0),
            bend_per_km: Waypoints::constant(0.0),
        }
    }
}

/// What may stand in a row beside the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BesideKind {
    /// Houses, front to front.
    Buildings,
    /// Trees.
    Trees,
    /// A green belt.
    Hedge,
    /// A steel rail on posts.
    GuardRail,
    /// A wall of bricks.
    Wall,
    /// Posts.
    Poles,
    /// Street lamps, lit at night.
    Lamps,
    /// Parked cars.
    ParkedCars,
}

/// A row of things beside the road.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BesideFile {
    /// What stands there.
    pub kind: BesideKind,
    /// Its near side (negative is left of the reference line).
    #[serde(deserialize_with = "lateral_m")]
    pub lateral_m: f64,
    /// Where the row starts along the road.
    #[serde(default, deserialize_with = "place_m")]
    pub from_m: f64,
    /// Where it ends.
    #[serde(deserialize_with = "place_m")]
    pub to_m: f64,
    /// From one to the next; each kind has its own.
    #[serde(default, deserialize_with = "spacing_m")]
    pub spacing_m: Option<f64>,
    /// Height, where the kind may differ in it.
    #[serde(default, deserialize_with = "size_m")]
    pub height_m: Option<f64>,
}

/// Single things.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObjectKind {
    /// A saloon car.
    Car,
    /// A delivery van.
    Van,
    /// A city bus.
    Bus,
    /// Someone on foot.
    Pedestrian,
    /// A traffic cone.
    Cone,
    /// A box of cardboard that fell off a lorry.
    Debris,
    /// A post.
    Pole,
    /// A piece of green belt.
    Hedge,
    /// A bridge across the road.
    Bridge,
    /// A plain block.
    Block,
}

/// A single thing, still or moving. It is placed by `along_m`, by `path` or by `ahead`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// What it is.
    pub kind: ObjectKind,
    /// Its near side along the road.
    #[serde(default, deserialize_with = "place_option_m")]
    pub along_m: Option<f64>,
    /// Its middle across the road.
    #[serde(default, deserialize_with = "lateral_m")]
    pub lateral_m: f64,
    /// Its speed along the road.
    #[serde(default, deserialize_with = "speed_m_s")]
    pub speed_m_s: f64,
    /// Its speed to the right.
    #[serde(default, deserialize_with = "speed_m_s")]
    pub across_m_s: f64,
    /// Where it is when: `[seconds, along, lateral]`.
    pub path: Option<Path>,
    /// The same, along counted from the vehicle: `[seconds, ahead, lateral]`.
    pub ahead: Option<Path>,
    /// Turned to the right; at 0 its rear is seen, at 180 its front.
    #[serde(default, deserialize_with = "turn_deg")]
    pub yaw_deg: f64,
    /// Mean grey of its paint, cloth or leaves.
    #[serde(default, deserialize_with = "grey")]
    pub grey: Option<f64>,
    /// Width, height and length; each kind has its own.
    #[serde(default, deserialize_with = "sizes_m")]
    pub size_m: Option<[f64; 3]>,
}

fn default_fps() -> f64 {
    12.5
}

fn within<E: Error>(value: f64, range: RangeInclusive<f64>, what: &str) -> Result<f64, E> {
    if range.contains(&value) {
        return Ok(value);
    }
    Err(E::custom(format!("{value} is out of range: give {what} from {} to {}", range.start(), range.end())))
}

macro_rules! ranged {
    ($($name:ident: $range:expr, $what:literal;)*) => {$(
        fn $name<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
            within(f64::deserialize(d)?, $range, $what)
        }
    )*};
}

macro_rules! ranged_option {
    ($($name:ident: $range:expr, $what:literal;)*) => {$(
        fn $name<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
            within(f64::deserialize(d)?, $range, $what).map(Some)
        }
    )*};
}

ranged! {
    duration_s: 0.1..=3600.0, "seconds";
    rate_hz: 0.1..=200.0, "pairs a second";
    angle_deg: -10.0..=10.0, "degrees";
    turn_deg: -360.0..=360.0, "degrees";
    kerb_m: 0.0..=0.5, "metres";
    width_m: 0.0..=50.0, "metres";
    strength: 0.0..=1.5, "a strength";
    share: 0.0..=1.0, "a share";
    lateral_m: -100.0..=100.0, "metres";
    place_m: -1000.0..=20_000.0, "metres";
    speed_m_s: -70.0..=70.0, "metres a second";
}

ranged_option! {
    camera_height_m: 0.3..=5.0, "metres";
    place_option_m: -1000.0..=20_000.0, "metres";
    spacing_m: 1.0..=1000.0, "metres";
    size_m: 0.1..=30.0, "metres";
    grey: 5.0..=250.0, "a grey value";
}

fn edges_m<'de, D: Deserializer<'de>>(d: D) -> Result<(f64, f64), D::Error> {
    let (left, right) = <(f64, f64)>::deserialize(d)?;
    within::<D::Error>(left, -50.0..=50.0, "metres")?;
    within::<D::Error>(right, -50.0..=50.0, "metres")?;
    if left < right {
        Ok((left, right))
    } else {
        Err(D::Error::custom("the left edge must be less than the right"))
    }
}

fn sizes_m<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[f64; 3]>, D::Error> {
    let sizes = <[f64; 3]>::deserialize(d)?;
    for size in sizes {
        within::<D::Error>(size, 0.02..=60.0, "metres")?;
    }
    Ok(Some(sizes))
}

/// Why a scene cannot be had. Every text names the file, the line or the value, and the remedy.
#[derive(Debug, Error)]
pub enum SceneError {
    /// No such scene.
    #[error("{name}: no such scene: give a TOML file, or one of {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The built-in scenes.
        known: String,
    },
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no scene.
    #[error("{file}{}: {reason}", line.map_or(String::new(), |line| format!(":{line}")))]
    File {
        /// The file, or the name of a built-in scene.
        file: String,
        /// Its line, from 1.
        line: Option<usize>,
        /// What is wrong and what to do.
        reason: String,
    },
    /// What follows the question mark.
    #[error(
        "{name}: {setting}: give weather=NAME, seed=N or rig=paper|kitti, joined by &; weathers are {weathers}"
    )]
    Setting {
        /// The whole name.
        name: String,
        /// The part that is wrong.
        setting: String,
        /// Names of the weathers.
        weathers: String,
    },
}

impl SceneFile {
    /// Parses the text of a scene; `file` is named in errors.
    ///
    /// # Errors
    /// With the line, the key or the value, and the remedy.
    pub fn parse(text: &str, file: &str) -> Result<Self, SceneError> {
        let fault = |line, reason: String| SceneError::File { file: file.to_owned(), line, reason };
        let scene: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
            let value =
                error.span().and_then(|span| text.get(span)).filter(|v| v.len() < 60 && !v.contains('\n'));
            let reason = error.message().trim_end().to_owned();
            fault(line, value.map_or(reason.clone(), |value| format!("{reason} (at `{value}`)")))
        })?;
        // What no single value can tell; the line is that of the nth [[objects]].
        let line_of = |header: &str, n: usize| {
            text.lines().zip(1..).filter(|(line, _)| line.trim() == header).nth(n).map(|(_, line)| line)
        };
        for (n, object) in scene.objects.iter().enumerate() {
            let places = [object.along_m.is_some(), object.path.is_some(), object.ahead.is_some()];
            if places.iter().filter(|&&given| given).count() != 1 {
                let reason = "place the object by exactly one of along_m, path and ahead".to_owned();
                return Err(fault(line_of("[[objects]]", n), reason));
            }
            if object.along_m.is_none() && (object.speed_m_s != 0.0 || object.across_m_s != 0.0) {
                let reason =
                    "speed_m_s and across_m_s go with along_m; path and ahead tell the motion".to_owned();
                return Err(fault(line_of("[[objects]]", n), reason));
            }
        }
        for (n, row) in scene.beside.iter().enumerate() {
            if row.from_m >= row.to_m || row.to_m - row.from_m > 5000.0 {
                let reason =
                    format!("from_m = {} and to_m = {}: give a row of up to 5000 m", row.from_m, row.to_m);
                return Err(fault(line_of("[[beside]]", n), reason));
            }
        }
        if scene.road.grade_percent.greatest() > 30.0 {
            return Err(fault(None, "road.grade_percent: give grades from -30 to 30 percent".into()));
        }
        if scene.road.bend_per_km.greatest() > 50.0 {
            return Err(fault(None, "road.bend_per_km: give bends from -50 to 50 (a radius of 20 m)".into()));
        }
        let angles = [&scene.camera.pitch_deg, &scene.camera.roll_deg];
        if angles.into_iter().flatten().any(|angle| angle.greatest() > 20.0) {
            return Err(fault(
                None,
                "camera.pitch_deg and roll_deg: give angles from -20 to 20 degrees".into(),
            ));
        }
        if scene.camera.right_pitch_deg.as_ref().is_some_and(|angle| angle.greatest() > 2.0) {
            return Err(fault(None, "camera.right_pitch_deg: give angles from -2 to 2 degrees".into()));
        }
        if scene.ego.speed_m_s.greatest() > 70.0 {
            return Err(fault(None, "ego.speed_m_s: give speeds from -70 to 70 m/s".into()));
        }
        let (_, size, _) = scene.camera.values().map_err(|error| fault(None, format!("camera: {error}")))?;
        if size.0.min(size.1) < 16 || size.0.max(size.1) > 4096 {
            return Err(fault(
                None,
                format!("camera: images of {}x{}: give sides of 16 to 4096 px", size.0, size.1),
            ));
        }
        Ok(scene)
    }
}

impl CameraFile {
    /// Rig, image size and height above the road.
    ///
    /// # Errors
    /// When the figures make no rig.
    pub fn values(&self) -> Result<(Rig, (usize, usize), f64), RigError> {
        let (named, size, height_m) = self.rig.values();
        let rig = Rig {
            focal_px: self.focal_px.unwrap_or(named.focal_px),
            baseline_m: self.baseline_m.unwrap_or(named.baseline_m),
            cx_px: self.cx_px.unwrap_or(named.cx_px),
            cy_px: self.cy_px.unwrap_or(named.cy_px),
        };
        let size = (self.width_px.map_or(size.0, usize::from), self.height_px.map_or(size.1, usize::from));
        Ok((rig.checked()?, size, self.height_m.unwrap_or(height_m)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        SceneFile::parse(text, "x.toml").unwrap_err().to_string()
    }

    #[test]
    fn faults_have_line_value_and_remedy() {
        let start = "title = \"x\"\nseconds = 2\n";
        for (more, expected) in [
            ("[camera]\nheight_m = 9\n", "x.toml:4: 9 is out of range: give metres from 0.3 to 5"),
            ("wether = \"snow\"\n", "x.toml:3: unknown field `wether`, expected one of"),
            ("weather = \"hail\"\n", "x.toml:3: unknown variant `hail`, expected one of `sunny`"),
            ("[[objects]]\nkind = \"car\"\n", "x.toml:3: place the object by exactly one of"),
            ("[[objects]]\nkind = \"car\"\nalong_m = \"far\"\n", "x.toml:5: invalid type: string \"far\""),
            ("[road]\ngrade_percent = [[0, 1], [0, 2]]\n", "x.toml:4: give a list of [place, value]"),
            ("[road]\ngrade_percent = 45\n", "x.toml: road.grade_percent: give grades"),
            ("[camera]\nright_pitch_deg = 5\n", "x.toml: camera.right_pitch_deg: give angles from -2"),
            ("[road\n", "x.toml:3: "),
            ("[camera]\nbaseline_m = -0.1\n", "a negative one means swapped cameras"),
            ("[[beside]]\nkind = \"trees\"\nlateral_m = 5\nto_m = -5\n", "x.toml:3: from_m = 0"),
        ] {
            let text = fault(&format!("{start}{more}"));
            assert!(text.contains(expected), "{more}\n{text}\nexpected {expected}");
        }
        assert!(fault("title = \"x\"\n").contains("missing field `seconds`"));
        assert!(SceneFile::parse(start, "x.toml").is_ok());
    }
}
