//! Format of scene files (TOML) and their validation.

use super::bay::BayFile;
pub use super::error::SceneError;
use super::motion::{Path, Waypoints};
use super::sensor::Sensor;
use super::strip::StripFile;
use crate::limits::SCENE;
use crate::toml_text;
use perception::rig::{Rig, RigError};
use serde::{Deserialize, Deserializer, de::Error};
use std::ops::RangeInclusive;

/// Contents of a scene file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// One-line description.
    pub title: String,
    /// Duration in seconds.
    #[serde(deserialize_with = "duration_s")]
    pub seconds: f64,
    /// Pairs per second.
    #[serde(default = "default_fps", deserialize_with = "rate_hz")]
    pub fps: f64,
    /// Whether it repeats without end.
    #[serde(default)]
    pub repeats: bool,
    /// Seed of textures, noise, rain and snow.
    #[serde(default)]
    pub seed: u64,
    /// Weather and lighting.
    #[serde(default)]
    pub weather: Weather,
    /// The stereo camera.
    #[serde(default)]
    pub camera: CameraFile,
    /// The vehicle's own motion.
    #[serde(default)]
    pub ego: EgoFile,
    /// The road.
    #[serde(default)]
    pub road: RoadFile,
    /// Rows of objects beside the road.
    #[serde(default)]
    pub beside: Vec<BesideFile>,
    /// Single objects, static or moving.
    #[serde(default)]
    pub objects: Vec<ObjectFile>,
}

/// Weather and lighting, as in the paper's table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weather {
    /// Bright sun from behind.
    #[default]
    Sunny,
    /// Wet road, thin streaks, a few drops on the lenses.
    LightRain,
    /// Streaks, spray, reflections on the road, many drops on the lenses.
    HeavyRain,
    /// Headlamps, street lamps, strong noise.
    Night,
    /// Falling flakes, ground covered.
    Snow,
    /// Low sun ahead: glare, saturation, dark near sides.
    Backlight,
    /// No direct sun, no shadows, dry.
    Overcast,
}

impl Weather {
    /// All values; the paper's six first, in its order.
    pub const ALL: [Self; 7] = [
        Self::Sunny,
        Self::LightRain,
        Self::HeavyRain,
        Self::Night,
        Self::Snow,
        Self::Backlight,
        Self::Overcast,
    ];

    /// Name in files and on the command line.
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

    /// The weather with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|weather| weather.name() == name)
    }
}

/// Predefined rigs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NamedRig {
    /// The paper's rig: 640 × 480 px, baseline 120 mm, focal length 879 px.
    #[default]
    Paper,
    /// KITTI's grey cameras: 1242 × 375 px, baseline 0.54 m, focal length 721 px.
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

/// The cameras: a predefined rig and overrides.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    /// Rig that provides the defaults.
    #[serde(default)]
    pub rig: NamedRig,
    /// Focal length in pixels.
    pub focal_px: Option<f64>,
    /// Baseline, in metres.
    pub baseline_m: Option<f64>,
    /// Column of the principal point, in pixels.
    pub cx_px: Option<f64>,
    /// Row of the principal point, in pixels.
    pub cy_px: Option<f64>,
    /// Image width, in pixels.
    pub width_px: Option<u16>,
    /// Image height, in pixels.
    pub height_px: Option<u16>,
    /// Height above the road, in metres.
    #[serde(default, deserialize_with = "camera_height_m")]
    pub height_m: Option<f64>,
    /// Pitch, nose down, in degrees; a number or a list of `[seconds, degrees]`.
    pub pitch_deg: Option<Waypoints>,
    /// Roll, clockwise, in degrees; a number or a list of `[seconds, degrees]`.
    pub roll_deg: Option<Waypoints>,
    /// Amplitude of the body's pitch oscillation, in degrees.
    #[serde(default, deserialize_with = "angle_deg")]
    pub sway_pitch_deg: f64,
    /// Amplitude of the body's roll oscillation, in degrees.
    #[serde(default, deserialize_with = "angle_deg")]
    pub sway_roll_deg: f64,
    /// Pitch of the right camera relative to the left one, nose down, as after a mount has slipped, in degrees; a
    /// number or a list of `[seconds, degrees]`. Ground truth and rig do not include it.
    pub right_pitch_deg: Option<Waypoints>,
    /// Left sensor, instead of the weather's.
    pub left: Option<Sensor>,
    /// Right sensor, instead of the weather's.
    pub right: Option<Sensor>,
}

/// The vehicle's own motion.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EgoFile {
    /// Speed along the road's reference line in m/s: a number or a list of `[seconds, m/s]`.
    pub speed_m_s: Waypoints,
    /// Lateral position in metres: a number or a list of `[seconds, metres]`, smooth in between.
    pub lateral_m: Waypoints,
    /// Start position along the road, in metres.
    pub along_m: f64,
}

impl Default for EgoFile {
    fn default() -> Self {
        Self { speed_m_s: Waypoints::constant(0.0), lateral_m: Waypoints::constant(0.0), along_m: 0.0 }
    }
}

/// The road. Lateral 0 is its reference line.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RoadFile {
    /// Left and right edge of the asphalt, in metres.
    #[serde(deserialize_with = "edges_m")]
    pub edges_m: (f64, f64),
    /// Height of the kerbs, in metres; 0 for none.
    #[serde(deserialize_with = "kerb_m")]
    pub kerb_m: f64,
    /// Width of the pavement beyond the kerbs, in metres.
    #[serde(deserialize_with = "width_m")]
    pub pavement_m: f64,
    /// Lateral positions of solid lane markings, in metres.
    pub solid_m: Vec<f64>,
    /// Lateral positions of dashed lane markings, in metres.
    pub dashed_m: Vec<f64>,
    /// Contrast of the asphalt's texture, 0 to 1.5.
    #[serde(deserialize_with = "strength")]
    pub texture: f64,
    /// Wetness of the ground, 0 to 1; rain makes it wet in any case.
    #[serde(deserialize_with = "share")]
    pub wet: f64,
    /// Rise in percent; a number or a list of `[along, percent]`.
    pub grade_percent: Waypoints,
    /// Curvature to the right in 1/km; a number or a list of `[along, 1/km]`.
    pub bend_per_km: Waypoints,
    /// Straight roads that cross it or go on where it turns off.
    pub branch: Vec<BranchFile>,
    /// Strips of ground beyond the asphalt, each side from its edge outwards. A side that has any has no kerb and no
    /// pavement by the values above. Objects stand on the ground of their place.
    pub strip: Vec<StripFile>,
    /// Lines across the asphalt at intervals.
    pub bays: Vec<BayFile>,
}

/// A straight road with the road's cross-section: one that crosses it, or that goes on where the road turns off.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BranchFile {
    /// Position along the road of its point 0, in metres.
    pub at_m: f64,
    /// Direction relative to the road there, in degrees, to the right positive.
    #[serde(default)]
    pub angle_deg: f64,
    /// Where it begins, in metres along it.
    pub from_m: f64,
    /// Where it ends, in metres along it.
    pub to_m: f64,
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
            branch: Vec::new(),
            strip: Vec::new(),
            bays: Vec::new(),
        }
    }
}

/// Kinds of objects in a row beside the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BesideKind {
    /// Houses in a closed row.
    Buildings,
    /// Trees.
    Trees,
    /// A green belt.
    Hedge,
    /// A steel guard rail on posts.
    GuardRail,
    /// A brick wall.
    Wall,
    /// Posts.
    Poles,
    /// Street lamps, lit at night.
    Lamps,
    /// Parked cars.
    ParkedCars,
    /// A wooden fence of boards with gaps.
    Fence,
    /// A wall of natural stone.
    StoneWall,
    /// A bank of earth, steep towards the road.
    Bank,
    /// A concrete barrier.
    Barrier,
    /// Traffic signs on posts.
    Signs,
    /// Single bushes.
    Bushes,
}

/// A row of objects beside the road.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BesideFile {
    /// Kind of the objects.
    pub kind: BesideKind,
    /// Lateral position of the near side, in metres (negative is left of the reference line).
    #[serde(deserialize_with = "lateral_m")]
    pub lateral_m: f64,
    /// Start of the row along the road, in metres.
    #[serde(default, deserialize_with = "place_m")]
    pub from_m: f64,
    /// End of the row, in metres.
    #[serde(deserialize_with = "place_m")]
    pub to_m: f64,
    /// Distance from one object to the next, in metres; the default depends on the kind.
    #[serde(default, deserialize_with = "spacing_m")]
    pub spacing_m: Option<f64>,
    /// Height in metres, for kinds with a variable height.
    #[serde(default, deserialize_with = "size_m")]
    pub height_m: Option<f64>,
    /// Length of a house along the road, in metres; by default 1 to 2 m less than the spacing.
    #[serde(default, deserialize_with = "size_m")]
    pub length_m: Option<f64>,
    /// Number of the branch, from 1, that it stands beside; the road itself by default.
    pub branch: Option<usize>,
    /// Mean grey value, for kinds with a variable one.
    #[serde(default, deserialize_with = "grey")]
    pub grey: Option<f64>,
}

/// Kinds of single objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObjectKind {
    /// A sedan.
    Car,
    /// A delivery van.
    Van,
    /// A city bus.
    Bus,
    /// A pedestrian.
    Pedestrian,
    /// A traffic cone.
    Cone,
    /// A cardboard box.
    Debris,
    /// A pole.
    Pole,
    /// A piece of hedge.
    Hedge,
    /// A bridge across the road.
    Bridge,
    /// A plain block.
    Block,
    /// A lorry.
    Lorry,
    /// A person on a bicycle.
    Cyclist,
    /// A bicycle on its stand.
    Bicycle,
}

/// A single object, static or moving. Exactly one of `along_m`, `path` and `ahead` positions it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// Kind of the object.
    pub kind: ObjectKind,
    /// Position of its near side along the road, in metres.
    #[serde(default, deserialize_with = "place_option_m")]
    pub along_m: Option<f64>,
    /// Lateral position of its centre, in metres.
    #[serde(default, deserialize_with = "lateral_m")]
    pub lateral_m: f64,
    /// Number of the branch, from 1, along which it is placed; the road itself by default.
    pub branch: Option<usize>,
    /// Speed along the road, in m/s.
    #[serde(default, deserialize_with = "speed_m_s")]
    pub speed_m_s: f64,
    /// Speed to the right, in m/s.
    #[serde(default, deserialize_with = "speed_m_s")]
    pub across_m_s: f64,
    /// Trajectory: `[seconds, along, lateral]`.
    pub path: Option<Path>,
    /// Trajectory relative to the vehicle: `[seconds, ahead, lateral]`.
    pub ahead: Option<Path>,
    /// Yaw to the right in degrees; at 0 its rear is visible, at 180 its front.
    #[serde(default, deserialize_with = "turn_deg")]
    pub yaw_deg: f64,
    /// Mean grey value of its surface.
    #[serde(default, deserialize_with = "grey")]
    pub grey: Option<f64>,
    /// Width, height and length, in metres; the default depends on the kind.
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
    rate_hz: 0.1..=200.0, "pairs per second";
    angle_deg: -10.0..=10.0, "degrees";
    turn_deg: -360.0..=360.0, "degrees";
    kerb_m: 0.0..=0.5, "metres";
    width_m: 0.0..=50.0, "metres";
    strength: 0.0..=1.5, "a strength";
    share: 0.0..=1.0, "a share";
    lateral_m: -100.0..=100.0, "metres";
    place_m: -1000.0..=20_000.0, "metres";
    speed_m_s: -70.0..=70.0, "metres per second";
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

impl SceneFile {
    /// Parses the text of a scene; `file` is the name for errors.
    ///
    /// # Errors
    /// Names the line, the key or the value, and the remedy.
    pub fn parse(text: &str, file: &str) -> Result<Self, SceneError> {
        let fault = |line, reason: String| SceneError::File { file: file.to_owned(), line, reason };
        SCENE.check(text.len() as u64).map_err(|error| fault(None, error.to_string()))?;
        let scene: Self = toml_text::parse(text).map_err(|error| fault(error.line, error.reason))?;
        scene.check_counts().map_err(|reason| fault(None, reason))?;
        // Checks across several values; the reported line is that of the nth header.
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
                    "speed_m_s and across_m_s require along_m; path and ahead define the motion".to_owned();
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
        if scene.road.grade_percent.max_abs() > 30.0 {
            return Err(fault(None, "road.grade_percent: give grades from -30 to 30 percent".into()));
        }
        scene.check_course().map_err(|reason| fault(None, reason))?;
        scene.check_bays().map_err(|reason| fault(None, reason))?;
        scene.check_strips().map_err(|reason| fault(None, reason))?;
        let angles = [&scene.camera.pitch_deg, &scene.camera.roll_deg];
        if angles.into_iter().flatten().any(|angle| angle.max_abs() > 20.0) {
            return Err(fault(
                None,
                "camera.pitch_deg and roll_deg: give angles from -20 to 20 degrees".into(),
            ));
        }
        if scene.camera.right_pitch_deg.as_ref().is_some_and(|angle| angle.max_abs() > 2.0) {
            return Err(fault(None, "camera.right_pitch_deg: give angles from -2 to 2 degrees".into()));
        }
        if scene.ego.speed_m_s.max_abs() > 70.0 {
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
    /// When the values do not form a valid rig.
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
        assert!(fault(&format!("{start}x = \"{}\"\n", "y".repeat(1 << 19))).len() < 2000);
        assert!(SceneFile::parse(start, "x.toml").is_ok());
    }
}
