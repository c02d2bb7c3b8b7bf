//! Ground truth of a frame.

use perception::motion::pose::Pose;
use perception::region::PixelBox;

/// Owner of a pixel on the road's asphalt.
pub const ROAD: u16 = 1;

/// Owner of a pixel on the ground beside it: kerb, pavement, grass.
pub const VERGE: u16 = 2;

/// First owner number of an object.
pub const FIRST_OBJECT: u16 = 3;

/// Class of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectClass {
    /// A car or a van.
    Car,
    /// A bus.
    Bus,
    /// A pedestrian.
    Pedestrian,
    /// A traffic cone.
    Cone,
    /// A box on the road.
    Debris,
    /// A post or a street lamp.
    Pole,
    /// A piece of hedge.
    Hedge,
    /// A piece of guard rail.
    GuardRail,
    /// A piece of wall.
    Wall,
    /// A house.
    Building,
    /// A tree.
    Tree,
    /// A bridge across the road.
    Bridge,
    /// A plain block.
    Block,
    /// A lorry.
    Lorry,
    /// A bicycle, with or without a rider.
    Bicycle,
    /// A piece of fence.
    Fence,
    /// A piece of a bank of earth.
    Bank,
    /// A bush.
    Bush,
}

impl ObjectClass {
    /// Name of the class.
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Bus => "bus",
            Self::Pedestrian => "pedestrian",
            Self::Cone => "cone",
            Self::Debris => "debris",
            Self::Pole => "pole",
            Self::Hedge => "hedge",
            Self::GuardRail => "guard rail",
            Self::Wall => "wall",
            Self::Building => "building",
            Self::Tree => "tree",
            Self::Bridge => "bridge",
            Self::Block => "block",
            Self::Lorry => "lorry",
            Self::Bicycle => "bicycle",
            Self::Fence => "fence",
            Self::Bank => "bank",
            Self::Bush => "bush",
        }
    }

    /// Whether it bounds the ground along the road: a polyline rather than a single object.
    pub fn is_boundary(self) -> bool {
        matches!(self, Self::Hedge | Self::GuardRail | Self::Wall | Self::Building | Self::Fence | Self::Bank)
    }
}

/// Ground truth of an object in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectTruth {
    /// Its number in [`SceneTruth::owner`], the same in all frames.
    pub id: u16,
    /// Class.
    pub class: ObjectClass,
    /// Whether the scene lists it as an object rather than as part of a row beside the road.
    pub subject: bool,
    /// Distance of its nearest visible point along the camera's axis, in metres.
    pub distance_m: f64,
    /// Centre of its box, in metres right of the left camera.
    pub lateral_m: f64,
    /// Width of its box across the road, in metres.
    pub width_m: f64,
    /// Height, in metres.
    pub height_m: f64,
    /// Distance to it along the vehicle's path, in metres: on a straight road [`Self::distance_m`], in a bend the way from
    /// the camera to where its nearest part is.
    pub along_m: f64,
    /// Speed at which [`Self::along_m`] decreases, in m/s.
    pub closing_m_s: f64,
    /// Bounding box of its visible pixels in the left image.
    pub bounds: PixelBox,
    /// Number of visible pixels.
    pub pixels: u32,
    /// Visible pixels ÷ pixels without occlusion; 1 for objects that are not subjects.
    pub visible: f64,
    /// Share of its visible pixels that are visible in the right image too.
    pub seen_by_both: f64,
    /// Whether any part of it is in the strip, 2.4 m wide, that the vehicle will drive through along the road.
    pub in_path: bool,
    /// Whether any part of it stands on the asphalt.
    pub on_road: bool,
}

/// Ground truth of the road in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadTruth {
    /// Disparity of the unoccluded asphalt in each row at the principal column, in px; 0 in rows without
    /// asphalt there.
    pub rows_px: Vec<f32>,
    /// (metres ahead, metres above the plane on which the vehicle stands) of the vehicle's path, from 0 to 120 m
    /// in steps of 0.5 m.
    pub profile_m: Vec<(f64, f64)>,
}

impl RoadTruth {
    /// Height of the road above the plane on which the vehicle stands, in metres, 0 to 120 m ahead.
    pub fn height_m(&self, ahead_m: f64) -> f64 {
        let k = ((ahead_m * 2.0).max(0.0) as usize).min(self.profile_m.len().saturating_sub(2));
        match self.profile_m.get(k..k + 2) {
            Some([a, b]) => a.1 + (b.1 - a.1) * (ahead_m - a.0) / (b.0 - a.0),
            _ => 0.0,
        }
    }
}

/// A boundary beside the road in one frame: hedge, wall, fence, guard rail, bank or building fronts.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundaryTruth {
    /// Its class; [`ObjectClass::is_boundary`].
    pub class: ObjectClass,
    /// Height above its foot, in metres.
    pub height_m: f64,
    /// Foot of the side that faces the vehicle: metres right of the left camera and metres ahead of it, on the ground
    /// as the vehicle stands on it, in the order of the row.
    pub points_m: Vec<[f64; 2]>,
    /// For each piece between two points, whether any pixel of it is visible in the left image.
    pub seen: Vec<bool>,
}

/// Free ground in one frame, for each column of the left image, in metres along the camera's axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreeGround {
    /// Distance up to which the column shows asphalt without a break, from the lowest row on, with nothing on it; 0 where
    /// the lowest row shows none. This much is truly free.
    pub free_m: Vec<f32>,
    /// Distance of the nearest thing on the ground that the column shows, of any class, named or not: overhangs higher than
    /// 2.2 m excepted; infinite where it shows none. Beyond it nothing is free. Between [`Self::free_m`] and this lies
    /// ground beside the asphalt, or hidden behind a crest: whether that is free is left open.
    pub blocked_m: Vec<f32>,
}

/// Own motion of the vehicle, at the left camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OwnMotion {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: f64,
    /// Acceleration, in m/s²: the rate of the speed.
    pub acceleration_m_s2: f64,
    /// Yaw rate, in rad/s, to the left positive; without the body's sway.
    pub yaw_rate_rad_s: f64,
    /// Transform from the left camera to the left camera of the first frame, with the body's pitch, roll and sway. Exact on
    /// roads of constant grade. Where the grade changes, the scene itself is rigid to the square of that change only. In a
    /// scene that repeats, each period starts anew.
    pub pose: Pose,
}

/// Ground truth of a frame. Maps have one value per pixel of the left image, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneTruth {
    /// Time in seconds from the start.
    pub time_s: f64,
    /// The vehicle's own speed, in m/s.
    pub ego_speed_m_s: f64,
    /// The vehicle's own motion.
    pub motion: OwnMotion,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Exact disparity at the pixel centre, in px; 0 at infinity.
    pub disparity_px: Vec<f32>,
    /// Whether the right camera sees the same point.
    pub in_both: Vec<bool>,
    /// 0 for the sky, [`ROAD`], [`VERGE`], or an object from [`FIRST_OBJECT`] on.
    pub owner: Vec<u16>,
    /// Objects with at least one visible pixel, nearest first.
    pub objects: Vec<ObjectTruth>,
    /// The road.
    pub road: RoadTruth,
    /// Boundaries beside the road, up to 100 m ahead.
    pub boundaries: Vec<BoundaryTruth>,
    /// Free ground.
    pub free: FreeGround,
}
