//! Main roads with guard rails, and motorways.

use super::dice::Dice;
use super::draft::{Draft, Motion, Row, Thing};
use super::street::green;
use super::traffic::{self, BEYOND_M, Lane, Pace, TRAFFIC_BEYOND_M, round};
use crate::scene::file::{BesideKind, ObjectKind};
use crate::scene::strip::{Cover, Side};

/// Where rows begin, in metres along the road: behind us.
const START_M: f64 = -30.0;

fn along_all(draft: &Draft) -> (f64, f64) {
    (START_M, round(draft.way_m() + BEYOND_M))
}

/// A rail or barrier along the whole road.
fn rail(draft: &mut Draft, kind: BesideKind, side: Side, out_m: f64, height_m: f64) {
    let along = along_all(draft);
    draft.row(Row { kind, side, out_m: round(out_m), along, height_m, grey: 150.0 });
}

/// Lamps, signs or delineators at intervals.
fn posts(draft: &mut Draft, dice: &mut Dice, kind: BesideKind, side: Side, out_m: f64, spacing: f64) {
    let (from, to) = along_all(draft);
    let height_m = match kind {
        BesideKind::Lamps => 9.0,
        BesideKind::Signs => dice.between(2.6, 4.0),
        _ => 1.05,
    };
    let mut at = from + dice.between(0.0, spacing);
    while at < to {
        let along = (round(at), round(at + 1.0));
        draft.single(Row { kind, side, out_m: round(out_m), along, height_m, grey: 100.0 }, 0.0);
        at += spacing;
    }
}

/// Bridges above the road, whose abutments stand beyond everything that runs along it.
fn bridges(draft: &mut Draft, dice: &mut Dice, (left, right): (f64, f64), count: usize) {
    for _ in 0..count {
        let at = dice.between(20.0, draft.way_m() + 120.0);
        let span = round(right + left + 1.0);
        let size_m = [span, dice.between(4.9, 6.0), dice.between(5.0, 14.0)];
        let place = (at, round(0.5 * (right - left)));
        let grey = dice.between(95.0, 160.0);
        draft.place(Thing {
            kind: ObjectKind::Bridge,
            size_m,
            at: place,
            motion: Motion::Still,
            yaw_deg: 0.0,
            grey,
        });
    }
}

/// What stands beyond the rail of one side, from `out_m` on: a noise barrier, a bank, a hedge, or trees alone.
fn screen(draft: &mut Draft, dice: &mut Dice, side: Side, out_m: f64) {
    let end = draft.way_m() + BEYOND_M;
    let mut at = START_M;
    while at < end {
        let long = dice.between(60.0, 260.0);
        let along = (round(at), round((at + long).min(end)));
        let kind = dice.weighted(&[
            (None, 0.45),
            (Some((BesideKind::Wall, 3.2)), 0.15),
            (Some((BesideKind::Bank, 2.2)), 0.2),
            (Some((BesideKind::Hedge, 2.0)), 0.1),
            (Some((BesideKind::Fence, 1.5)), 0.1),
        ]);
        if let Some((kind, height)) = kind {
            let height_m = round(height * dice.between(0.7, 1.3));
            draft.row(Row {
                kind,
                side,
                out_m: round(out_m),
                along,
                height_m,
                grey: dice.between(65.0, 110.0),
            });
        }
        at += long + dice.between(1.0, 15.0);
    }
    let dense = dice.between(0.3, 1.0);
    green(draft, dice, side, (out_m + 7.0, out_m + 12.0), dense);
    green(draft, dice, side, (out_m + 13.0, out_m + 20.0), dense);
}

/// A main road: two or four lanes, guard rails or barriers.
pub fn main_road(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "main road");
    let pace = dice.weighted(&[(Pace::Steady, 0.45), (Pace::Varied, 0.4), (Pace::Stop, 0.15)]);
    let speed = dice.between(12.0, 23.0);
    traffic::drive_at(draft, speed, pace);
    let bend = if dice.chance(0.6) { dice.between(0.8, 6.0) } else { 0.0 };
    let grade = if dice.chance(0.5) { dice.between(1.5, 4.5) } else { 0.0 };
    traffic::course(draft, bend, grade);
    let count = dice.weighted(&[(1, 0.5), (2, 0.5)]);
    let width = dice.between(3.2, 3.6);
    let shoulder = dice.between(0.4, 1.8);
    // A central reserve between four lanes.
    let reserve = if count == 2 && dice.chance(0.6) { dice.between(1.2, 2.2) } else { 0.0 };
    let half = 0.5 * reserve;
    let all = round(half + count as f64 * width);
    draft.edges = (-round(all + shoulder), round(all + shoulder));
    draft.lines.0 = if reserve > 0.0 { vec![-all, -half, half, all] } else { vec![-all, all] };
    draft.lines.1 = if reserve > 0.0 { Vec::new() } else { vec![0.0] };
    if count == 2 {
        draft.lines.1.extend([-round(half + width), round(half + width)]);
    }
    let middles: Vec<f64> = (0..count).map(|k| round(half + (k as f64 + 0.5) * width)).collect();
    let own = dice.whole(0, count - 1);
    draft.lateral = vec![(0.0, round(middles[own] + dice.between(-0.1, 0.1)))];
    let mut rails = [0.0; 2];
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        let step = if dice.chance(0.3) { dice.between(0.05, 0.14) } else { 0.0 };
        let wide = dice.between(1.2, 2.4);
        let verge = draft.strip(side, wide, (step, round(wide * dice.between(-0.05, 0.03))), Cover::Grass);
        rails[k] = verge.0 + dice.between(0.3, 0.8);
        draft.strip(side, 25.0, (0.0, dice.between(-1.5, 0.8)), Cover::Grass);
    }
    draft.drive();
    let kind = dice.weighted(&[(BesideKind::GuardRail, 0.75), (BesideKind::Barrier, 0.25)]);
    if reserve > 0.0 {
        let middle = if kind == BesideKind::Barrier { 0.3 } else { 0.07 };
        rail(draft, kind, Side::Right, -middle, if kind == BesideKind::Barrier { 0.85 } else { 0.75 });
    }
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        if dice.chance(0.85) {
            let kind = dice.weighted(&[(BesideKind::GuardRail, 0.8), (BesideKind::Barrier, 0.2)]);
            rail(draft, kind, side, rails[k], dice.between(0.7, 0.85));
        }
    }
    if dice.chance(0.4) {
        bridges(draft, &mut dice, (rails[0] + 9.0, rails[1] + 9.0), 1);
    }
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        if dice.chance(0.4) {
            posts(draft, &mut dice, BesideKind::Lamps, side, rails[k] + 1.2, 38.0);
        }
        posts(draft, &mut dice, BesideKind::Signs, side, rails[k] + 1.3, 120.0);
        screen(draft, &mut dice, side, rails[k] + 2.6);
    }
    let heavy = (dice.between(0.05, 0.3), 0.03);
    flow(draft, &mut dice, &Flow { middles, own, speed, heavy, mirror: 0.0 });
}

/// Traffic in both directions.
struct Flow {
    /// Middles of our lanes, from left to right.
    middles: Vec<f64>,
    /// Which is ours.
    own: usize,
    /// Our speed, in m/s.
    speed: f64,
    /// Shares of lorries and buses.
    heavy: (f64, f64),
    /// The others' lanes are ours, mirrored: this minus the lateral position.
    mirror: f64,
}

fn flow(draft: &mut Draft, dice: &mut Dice, flow: &Flow) {
    let Flow { own, speed, heavy, mirror, .. } = *flow;
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    if dice.chance(0.5) {
        let near = dice.between(10.0, 20.0);
        let far = near + dice.between(15.0, 45.0);
        traffic::lead(draft, dice, (near, far), heavy);
    }
    let reach = end + 1.2 * speed * draft.seconds;
    for (k, &lateral) in flow.middles.iter().enumerate() {
        if k != own {
            // The lanes on the left are faster.
            let speed_m_s =
                round(speed * if k < own { dice.between(1.03, 1.3) } else { dice.between(0.7, 0.97) });
            let along = (if k < own { -120.0 } else { 5.0 }, end);
            let gap = dice.pick(&[(12.0, 50.0), (25.0, 110.0)]);
            let heavy = if k < own { (0.0, 0.0) } else { (2.0 * heavy.0, heavy.1) };
            traffic::lane(draft, dice, Lane { lateral, speed_m_s, along, gap, heavy });
        }
        let speed_m_s = -round(speed * dice.between(0.8, 1.2));
        let gap = dice.pick(&[(15.0, 70.0), (30.0, 150.0), (80.0, 300.0)]);
        traffic::lane(
            draft,
            dice,
            Lane { lateral: round(mirror - lateral), speed_m_s, along: (20.0, reach), gap, heavy },
        );
    }
}

/// A motorway: two or three lanes, hard shoulder, central reserve, the other carriageway, lorries, bridges.
pub fn motorway(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "motorway");
    let is_slow = dice.chance(0.12);
    let speed = if is_slow { dice.between(5.0, 12.0) } else { dice.between(22.0, 34.0) };
    let pace = if is_slow { Pace::Varied } else { dice.pick(&[Pace::Steady, Pace::Steady, Pace::Varied]) };
    traffic::drive_at(draft, speed, pace);
    let bend = if dice.chance(0.7) { dice.between(0.3, 2.0) } else { 0.0 };
    let grade = if dice.chance(0.5) { dice.between(1.0, 4.0) } else { 0.0 };
    traffic::course(draft, bend, grade);
    let count = dice.pick(&[2, 2, 3]);
    let width = dice.between(3.5, 3.75);
    let all = round(count as f64 * width);
    let (inner, shoulder) = (dice.between(0.5, 1.0), dice.between(2.2, 3.0));
    draft.edges = (-inner, round(all + shoulder));
    draft.lines.0 = vec![0.0, all];
    draft.lines.1 = (1..count).map(|k| round(k as f64 * width)).collect();
    let middles: Vec<f64> = (0..count).map(|k| round((k as f64 + 0.5) * width)).collect();
    let own = dice.whole(0, count - 1);
    draft.lateral = vec![(0.0, round(middles[own] + dice.between(-0.15, 0.15)))];
    if dice.chance(0.3) {
        let other = if own == 0 { 1 } else { own - 1 };
        let (from, long) = (dice.between(1.0, draft.seconds - 7.0), dice.between(4.0, 6.0));
        let start = draft.lateral[0].1;
        draft.lateral.extend([(from, start), (round(from + long), middles[other])]);
    }
    // The central reserve and the other carriageway.
    let reserve = dice.between(2.4, 4.5);
    let middle = inner + 0.5 * reserve;
    draft.strip(Side::Left, reserve, (0.0, 0.0), dice.pick(&[Cover::Grass, Cover::Gravel]));
    let other = draft.strip(Side::Left, round(inner + all + shoulder), (0.0, 0.0), Cover::Asphalt);
    let mirror = -2.0 * middle;
    draft.lines.0.extend([round(mirror), round(mirror - all)]);
    draft.lines.1.extend((1..count).map(|k| round(mirror - k as f64 * width)));
    let mut rails = [other.1 + 0.6, draft.edge(Side::Right) + 0.6];
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        let wide = dice.between(1.4, 3.0);
        let verge = draft.strip(side, wide, (0.0, round(wide * dice.between(-0.06, 0.02))), Cover::Grass);
        rails[k] = verge.0 + dice.between(0.4, 0.8);
        draft.strip(side, 25.0, (0.0, dice.between(-2.0, 1.0)), Cover::Grass);
    }
    draft.drive();
    if dice.chance(0.4) {
        rail(draft, BesideKind::Barrier, Side::Left, middle - 0.3, 0.9);
    } else {
        rail(draft, BesideKind::GuardRail, Side::Left, inner + 0.5, 0.75);
        rail(draft, BesideKind::GuardRail, Side::Left, inner + reserve - 0.6, 0.75);
    }
    rail(draft, BesideKind::GuardRail, Side::Left, rails[0], 0.75);
    if dice.chance(0.8) {
        rail(draft, BesideKind::GuardRail, Side::Right, rails[1], 0.75);
    }
    let count = dice.whole(0, 2);
    bridges(draft, &mut dice, (rails[0] + 9.5, rails[1] + 9.5), count);
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        posts(draft, &mut dice, BesideKind::Poles, side, rails[k] + 0.9, 50.0);
        posts(draft, &mut dice, BesideKind::Signs, side, rails[k] + 1.3, 160.0);
        screen(draft, &mut dice, side, rails[k] + 2.6);
    }
    let heavy = (dice.between(0.15, 0.5), 0.03);
    flow(draft, &mut dice, &Flow { middles, own, speed, heavy, mirror });
    broken_down(draft, &mut dice, all + 0.5 * shoulder);
}

/// A vehicle that stands on the hard shoulder, at times.
fn broken_down(draft: &mut Draft, dice: &mut Dice, lateral: f64) {
    if dice.chance(0.35) {
        let (kind, size_m, grey) = traffic::vehicle(dice, 0.2, 0.0);
        let at = (dice.between(30.0, draft.way_m() + 60.0), round(lateral));
        draft.place(Thing { kind, size_m, at, motion: Motion::Still, yaw_deg: 0.0, grey });
    }
}
