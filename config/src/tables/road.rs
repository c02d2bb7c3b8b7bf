//! The road surface and the regions above it.

use crate::key::Reload;
use crate::table::table;
use perception::detection::RegionParameters as Region;
use perception::road::{RoadParameters, Shape};

table! {
    /// Road surface model.
    pub struct Road, reload: Reload::Readers;

    /// Minimum height of the camera above the road.
    camera_height_min_m: Number(0.1, 10.0) in "m" = RoadParameters::default().camera_height_m.0;

    /// Maximum height of the camera above the road.
    camera_height_max_m: Number(0.1, 10.0) in "m" = RoadParameters::default().camera_height_m.1;

    /// Maximum distance of the horizon from the principal row, caused by pitch, as a fraction of the image height.
    horizon_share: Number(0.02, 0.5) = RoadParameters::default().horizon_share;

    /// Minimum fraction of its rows in which the road must be supported. Below it the road counts as not visible
    /// and the alarm is off.
    least_support: Number(0.0, 1.0) = RoadParameters::default().min_support;

    /// Road model: `profile` follows crests, dips and slopes; `plane` is a single plane, for comparison.
    shape: Choice(&["profile", "plane"]) = shape();
}

fn shape() -> &'static str {
    match RoadParameters::default().shape {
        Shape::Profile => "profile",
        Shape::Plane => "plane",
    }
}

table! {
    /// Detection of obstacle regions above the road.
    pub struct Regions, reload: Reload::Readers;

    /// Minimum height of an obstacle above the road; lower structures count as road.
    height_min_m: Number(0.05, 3.0) in "m" = Region::default().min_height_m;

    /// Height above the road beyond which nothing obstructs the vehicle.
    height_max_m: Number(0.5, 20.0) in "m" = Region::default().max_height_m;

    /// Maximum distance of a region; 0 = as far as the rig tells things from the road (disparity 1.75 px, a car of 12 px), from 60 to 100 m, and farther (1.25 px) where traffic that comes as fast as we drive is met within 3.2 s.
    distance_max_m: Number(0.0, 300.0) in "m" = 0.0;

    /// Minimum width of a region; narrower ones are noise.
    width_min_m: Number(0.02, 5.0) in "m" = Region::default().min_width_m;

    /// Maximum extent of a region in depth, where noise does not span more; longer objects, such as hedges, are split.
    depth_span_m: Number(0.5, 100.0) in "m" = Region::default().depth_span_m;

    /// Minimum number of pixels of a region; smaller ones are noise.
    pixels_min: Whole(1, 100_000) in "px" = Region::default().min_pixels;

    /// Maximum number of regions per frame; those with most evidence are kept.
    count_max: Whole(1, 64) = Region::default().max_count;
}
