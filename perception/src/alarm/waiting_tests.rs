//! Tests of warnings that wait until more is known of a thing or of the road.

use super::drives::arc;
use super::path::LateralMotion;
use super::*;
use crate::tracking::filter::TimeToCollision;
use crate::tracking::filter::ground::{GroundMotion, Movement};

#[test]
fn a_warning_of_what_comes_from_beside_waits_while_it_may_pass() {
    // At 10 m/s. Its speed to the right and ahead, how exactly that is known (m/s), and its place beside the path as we arrive (m).
    type Moving = ([f64; 2], f64, f64);
    let level_at_with =
        |seconds: f64, (speed_m_s, sigma_m_s, beside_m): Moving, with: fn(Candidate) -> Candidate| {
            let mut alarm = Alarm::new(AlarmParameters::default());
            let closing_m_s = 10.0 - speed_m_s[1];
            let moves = speed_m_s != [0.0; 2];
            let thing = Candidate {
                track: 1,
                seen: 20,
                consecutive_frames: 20,
                distance_m: closing_m_s * seconds + Body::default().front_m,
                closing_m_s,
                time_to_collision: Some(TimeToCollision { seconds, sigma_s: 0.05 }),
                motion: LateralMotion {
                    lateral_m: beside_m - speed_m_s[0] * seconds,
                    width_m: 5.0,
                    ..LateralMotion::default()
                },
                ground: Some(GroundMotion {
                    speed_m_s,
                    speed_sigma_m_s: [sigma_m_s; 2],
                    place_sigma_m: [0.1; 2],
                    correlations: [0.0; 6],
                    movement: if moves { Movement::Moving } else { Movement::Standing },
                }),
                ..Candidate::default()
            };
            let update = |frame: u64| {
                alarm.update_on_path(frame * 80_000_000, true, Some(arc(0.0, 10.0)), [with(thing)]).level
            };
            (0..3).map(update).last().unwrap()
        };
    let level_at = |seconds, thing| level_at_with(seconds, thing, |thing| thing);
    use AlarmLevel::{Alarm as Alarms, Clear, Warning};
    // What stands, walks ahead of us, crosses as is well known, and as may be.
    let things =
        [([0.0, 0.0], 0.1, 0.0), ([0.0, 1.0], 0.8, 0.0), ([4.0, 0.0], 0.1, 0.0), ([4.0, 0.0], 0.8, 1.5)];
    let levels = |seconds| things.map(|thing| level_at(seconds, thing));
    assert_eq!(levels(2.4), [Warning, Warning, Warning, Clear]);
    assert_eq!(levels(2.0), [Warning; 4]);
    assert_eq!(levels(1.2), [Alarms; 4]);
    // What stands before a wall that is as high is beside the road, which bends; farther away from the wall it is on it.
    let beside =
        |seconds| level_at_with(seconds, things[0], |thing| Candidate { before_wall_m: Some(1.0), ..thing });
    assert_eq!([2.4, 2.0, 1.2].map(beside), [Clear, Warning, Alarms]);
    let on_road = |thing| Candidate { before_wall_m: Some(4.0), ..thing };
    assert_eq!(level_at_with(2.4, things[0], on_road), Warning);
    // Who comes towards us in our lane is not beside it, whatever is in doubt of our path.
    assert_eq!(level_at(2.5, ([0.0, -3.0], 0.3, 1.5)), Warning);
}
