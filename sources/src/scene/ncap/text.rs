//! A run as the text of a scene file.

use super::case::Case;
use super::course::{Course, OWN_WIDTH_M};
use super::row::{Miss, Motion};
use crate::scene::file::{SceneError, SceneFile};
use crate::scene::random::dice::Dice;
use std::fmt::Write;

/// Faster, the scene is a country road, in km/h.
const MAX_TOWN_KM_H: f64 = 60.0;

/// Everything beside the road reaches so far beyond the impact, in metres.
const BEYOND_M: f64 = 150.0;

/// Free ground to either side of where somebody crosses, in metres: walkers start at the kerb, others come from afar.
const FREE_M: (f64, f64) = (1.5, 30.0);

/// Clearance of the parked cars that hide the target, in metres.
const PARKED_CLEARANCE_M: f64 = 1.0;

/// Way from the parked cars or the wall to the target, in metres.
const BEHIND_PARKED_M: f64 = 0.5;

/// Wall that hides a bicycle, to the right of our middle, in metres.
const WALL_M: f64 = 2.5;

/// A car that is parked: width, height, length, in metres.
const PARKED_M: [f64; 3] = [1.75, 1.45, 4.2];

/// The scene of a run.
///
/// # Errors
/// When the file format refuses it, which no run of the table does.
pub fn scene(case: &Case) -> Result<SceneFile, SceneError> {
    SceneFile::parse(&text(case), &case.id())
}

/// The text of the scene file of a run. The target is its first object.
pub fn text(case: &Case) -> String {
    let course = Course::new(case);
    let mut dice = Dice::new(case.seed, &case.row.label());
    let mut out = String::new();
    head(&mut out, case, &course, &mut dice);
    beside(&mut out, case, &course, &mut dice);
    target(&mut out, case, &course, &mut dice);
    hiding(&mut out, case, &course, &mut dice);
    out
}

fn head(out: &mut String, case: &Case, course: &Course, dice: &mut Dice) {
    let title = format!("{}, {} km/h", case.row.title, case.own_km_h);
    let seconds = course.lead_s + 1.0;
    let _ = writeln!(
        out,
        "title = \"{title}\"\nseconds = {seconds:.4}\nfps = {}\nseed = {}",
        case.fps, case.seed
    );
    let _ = writeln!(out, "weather = \"{}\"", case.weather.name());
    let (pitch, roll) = (dice.between(0.06, 0.2), dice.between(0.1, 0.3));
    let _ = writeln!(out, "\n[camera]\nrig = \"{}\"", case.rig.name());
    let _ = writeln!(out, "sway_pitch_deg = {pitch:.2}\nsway_roll_deg = {roll:.2}");
    let _ = writeln!(out, "\n[ego]\nspeed_m_s = {:.9}", course.own_m_s);
    let right = course.right_edge_m;
    // A road with branches has no kerbs.
    let (kerb, pavement) = if course.branch.is_some() { (0.0, 0.0) } else { (0.12, 2.5) };
    let _ = writeln!(out, "\n[road]\nedges_m = [-5.25, {right}]\nkerb_m = {kerb}\npavement_m = {pavement}");
    let _ = writeln!(out, "solid_m = [-5, {:.2}]\ndashed_m = [-1.75, 1.75]", right - 0.15);
    let _ = writeln!(out, "texture = {:.2}", dice.between(0.7, 1.2));
    let points: Vec<String> = course.bend.iter().map(|p| format!("[{:.6}, {:.9}]", p.0, p.1)).collect();
    if points.len() > 1 {
        let _ = writeln!(out, "bend_per_km = [{}]", points.join(", "));
    }
    if let Some(branch) = course.branch {
        let (at, angle, from, to) = (branch.at_m, branch.angle_deg, branch.from_m, branch.to_m);
        let _ = writeln!(
            out,
            "\n[[road.branch]]\nat_m = {at:.6}\nangle_deg = {angle:.1}\nfrom_m = {from:.1}\nto_m = {to:.1}"
        );
    }
}

/// A row beside the road, unless it is too short.
fn row(out: &mut String, kind: &str, lateral_m: f64, (from, to): (f64, f64), more: &str) {
    if to - from > 2.0 {
        let _ = writeln!(
            out,
            "\n[[beside]]\nkind = \"{kind}\"\nlateral_m = {lateral_m:.2}\nfrom_m = {from:.2}\nto_m = {to:.2}{more}"
        );
    }
}

/// What stands beside the road: a street, or a country road where we are fast. Nothing of it hides the target.
fn beside(out: &mut String, case: &Case, course: &Course, dice: &mut Dice) {
    let meeting = course.meeting_m();
    let (start, end) = (-10.0, meeting + BEYOND_M);
    let crosses = matches!(case.row.motion, Motion::Crosses { .. });
    let parts = if let Some(turn) = case.row.turn.and(course.branch) {
        for side in [-1.0, 1.0] {
            row(out, "buildings", side * 10.0, (25.0, 85.0), "\nbranch = 1");
        }
        vec![(start, turn.at_m - 10.0), (meeting + 18.0, end)]
    } else if crosses {
        let free_m = if case.row.target.walks() { FREE_M.0 } else { FREE_M.1 };
        vec![(start, meeting - free_m), (meeting + free_m, end)]
    } else {
        vec![(start, end)]
    };
    let is_town = case.own_km_h <= MAX_TOWN_KM_H;
    let spacing = |m: f64| format!("\nspacing_m = {m:.2}");
    for (side, edge) in [(-1.0, 5.25), (1.0, course.right_edge_m)] {
        let (house, tree) = (dice.between(9.5, 12.5), edge + dice.between(3.0, 3.6));
        let (every, first) = (dice.between(13.0, 22.0), dice.between(0.0, 10.0));
        for &(from, to) in &parts {
            if is_town {
                row(out, "buildings", side * house, (from, to), "");
                row(out, "trees", side * tree, (from + first, to - 2.0), &spacing(every));
            } else {
                row(out, "hedge", side * house, (from, to), "\nheight_m = 1.4");
                row(out, "guard_rail", side * (edge + 0.8), (from, to), "");
                row(out, "trees", side * (house + 3.0), (from + first, to), &spacing(every));
            }
        }
    }
}

fn target(out: &mut String, case: &Case, course: &Course, dice: &mut Dice) {
    let (kind, [width, height, length]) = case.row.target.model();
    let kind = format!("{kind:?}").to_lowercase();
    let grey = dice.pick(&[45.0, 60.0, 80.0, 100.0, 125.0, 150.0, 175.0, 200.0]);
    let points: Vec<String> =
        course.way.points.iter().map(|p| format!("[{:.2},{:.6},{:.6}]", p[0], p[1], p[2])).collect();
    let _ =
        writeln!(out, "\n# The target.\n[[objects]]\nkind = \"{kind}\"\nyaw_deg = {:.0}", course.way.yaw_deg);
    let _ = writeln!(out, "grey = {grey:.0}\nsize_m = [{width}, {height}, {length}]");
    if course.way.road > 0 {
        let _ = writeln!(out, "branch = {}", course.way.road);
    }
    let _ = writeln!(out, "path = [{}]", points.join(","));
}

/// What hides the target: parked cars hide a child, a wall hides a bicycle.
fn hiding(out: &mut String, case: &Case, course: &Course, dice: &mut Dice) {
    let Motion::Crosses { is_hidden: true, .. } = case.row.motion else { return };
    if !case.row.target.walks() {
        let to = course.meeting_m() - BEHIND_PARKED_M;
        row(out, "wall", WALL_M, (to - 80.0, to), "\nheight_m = 2.2\nspacing_m = 4");
        return;
    }
    let [width, height, length] = PARKED_M;
    let lateral = 0.5 * (OWN_WIDTH_M + width) + PARKED_CLEARANCE_M;
    let mut far = course.meeting_m() - BEHIND_PARKED_M;
    for _ in 0..2 {
        let grey = dice.pick(&[50.0, 85.0, 120.0, 165.0, 195.0]);
        let along = far - length;
        let _ = writeln!(
            out,
            "\n[[objects]]\nkind = \"car\"\nalong_m = {along:.3}\nlateral_m = {lateral:.3}\ngrey = {grey:.0}\n\
             size_m = [{width}, {height}, {length}]"
        );
        far = along - 1.0;
    }
}

/// Whether a near miss has the target in a bend, so that our vehicle turns.
pub fn turns(case: &Case) -> bool {
    case.row.turn.is_some() || case.miss == Some(Miss::InBend)
}
