//! Parameters of road model and detection from the configuration.

use crate::stages::whole_number::whole;
use config::Config;
use perception::detection::RegionParameters;
use perception::range::Range;
use perception::rig::Rig;
use perception::road::{RoadParameters, Shape};
use perception::scene::SceneParameters;
use perception::tracking::TrackerParameters;

/// How far things are detected with a rig: as configured, or by the rig.
pub fn range(config: &Config, rig: &Rig) -> Range {
    let configured_m = config.regions.distance_max_m;
    if configured_m > 0.0 { Range::fixed(configured_m) } else { Range::of(rig) }
}

/// Parameters of the road model and of the regions.
pub fn scene_parameters(config: &Config, rig: &Rig) -> SceneParameters {
    let (c, r) = (&config.road, &config.regions);
    SceneParameters {
        road: RoadParameters {
            camera_height_m: (c.camera_height_min_m, c.camera_height_max_m),
            horizon_share: c.horizon_share,
            min_support: c.least_support,
            shape: if c.shape == "plane" { Shape::Plane } else { Shape::Profile },
        },
        regions: RegionParameters {
            min_height_m: r.height_min_m,
            max_height_m: r.height_max_m,
            max_distance_m: range(config, rig).slow_m,
            min_width_m: r.width_min_m,
            depth_span_m: r.depth_span_m,
            min_pixels: whole(r.pixels_min),
            max_count: whole(r.count_max),
            confirm: true,
        },
        path_width_m: config.alarm.path_width_m,
    }
}

/// Parameters of the tracker.
pub fn tracker_parameters(config: &Config, rig: &Rig) -> TrackerParameters {
    let c = &config.tracking;
    TrackerParameters {
        confirm_probability: c.confirm_probability,
        max_unseen_s: c.unseen_max_s,
        min_overlap: c.overlap_min,
        max_distance_m: range(config, rig).slow_m,
        max_disparity_px: config.stereo.disparities as f64,
        max_count: messages::track::MAX_TRACKS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_configuration_matches_the_defaults_of_the_algorithms() {
        let mut config = Config::default();
        let rig = Rig { focal_px: 900.0, baseline_m: 0.3, cx_px: 640.0, cy_px: 360.0 };
        assert_eq!((range(&config, &rig), config.regions.distance_max_m), (Range::of(&rig), 0.0));
        config.regions.distance_max_m = 60.0;
        assert_eq!(scene_parameters(&config, &rig), SceneParameters::default());
        assert_eq!(tracker_parameters(&config, &rig), TrackerParameters::default());
    }
}
