//! Country roads.

use super::dice::Dice;
use super::draft::{Draft, Motion, Row, Thing};
use super::street::{green, houses};
use super::traffic::{self, BEYOND_M, Lane, Pace, TRAFFIC_BEYOND_M, round};
use crate::scene::file::BesideKind;
use crate::scene::strip::{Cover, Side};

/// What lies beyond the verge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beyond {
    Ditch,
    Bank,
    Field,
    Slope,
}

/// A country road.
pub fn country(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "country");
    let pace = dice.weighted(&[(Pace::Steady, 0.45), (Pace::Varied, 0.45), (Pace::Stop, 0.1)]);
    let speed = dice.between(11.0, 24.0);
    traffic::drive_at(draft, speed, pace);
    let bend = if dice.chance(0.75) { dice.between(1.5, 14.0) } else { 0.0 };
    let grade = if dice.chance(0.6) { dice.between(2.0, 6.0) } else { 0.0 };
    traffic::course(draft, bend, grade);
    let width = dice.between(2.9, 3.5);
    let margin = dice.between(0.1, 0.6);
    draft.edges = (-round(width + margin), round(width + margin));
    draft.lines.1 = if dice.chance(0.8) { vec![0.0] } else { Vec::new() };
    draft.lines.0 = if dice.chance(0.6) { vec![-width, width] } else { Vec::new() };
    let lateral = round(0.5 * width + dice.between(-0.1, 0.15));
    draft.lateral = vec![(0.0, lateral)];
    let mut beyond = [Beyond::Field; 2];
    let mut verges = [(0.0, 0.0); 2];
    let mut track = None;
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        let wide = dice.between(1.6, 3.2);
        let step = dice.pick(&[0.0, 0.02, 0.05, 0.08]);
        verges[k] = draft.strip(
            side,
            wide,
            (step, round(wide * dice.pick(&[-0.06, -0.03, 0.0, 0.04]))),
            Cover::Grass,
        );
        if side == Side::Right && dice.chance(0.3) {
            track = Some(draft.strip(side, dice.between(1.8, 2.6), (0.0, 0.0), Cover::Asphalt));
            draft.strip(side, 1.0, (0.0, 0.0), Cover::Grass);
        }
        let kinds = [Beyond::Ditch, Beyond::Bank, Beyond::Field, Beyond::Slope];
        beyond[k] = dice.pick(&kinds);
        match beyond[k] {
            Beyond::Ditch => {
                let (deep, wide) = (dice.between(0.4, 0.9), dice.between(0.9, 1.6));
                draft.strip(side, wide, (0.0, -deep), Cover::Grass);
                draft.strip(side, 0.4, (0.0, 0.0), Cover::Earth);
                draft.strip(side, wide, (0.0, deep), Cover::Grass);
            }
            Beyond::Slope => {
                let wide = dice.between(4.0, 9.0);
                draft.strip(side, wide, (0.0, round(wide * dice.between(-0.25, 0.25))), Cover::Grass);
            }
            Beyond::Bank | Beyond::Field => {}
        }
        let cover = dice.pick(&[Cover::Grass, Cover::Earth, Cover::Lawn]);
        draft.strip(side, 24.0, (0.0, dice.between(-0.6, 0.6)), cover);
    }
    draft.drive();
    traffic_of(draft, &mut dice, lateral, width, speed);
    if let Some((inner, outer)) = track {
        let towards_us = dice.chance(0.4);
        let count = dice.whole(1, 5);
        traffic::cyclists(draft, &mut dice, 0.5 * (inner + outer), towards_us, count);
    }
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        if dice.chance(0.3) {
            on_verge(draft, &mut dice, side, verges[k]);
        }
        roadside(draft, &mut dice, side, verges[k], beyond[k]);
    }
}

fn traffic_of(draft: &mut Draft, dice: &mut Dice, own: f64, width: f64, speed: f64) {
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    let heavy = (dice.between(0.0, 0.3), 0.03);
    if dice.chance(0.35) {
        let near = dice.between(9.0, 16.0);
        traffic::lead(draft, dice, (near, 55.0), heavy);
    }
    let speed_m_s = -speed * dice.between(0.7, 1.2);
    let gap = dice.pick(&[(15.0, 60.0), (30.0, 140.0), (80.0, 300.0)]);
    let lane = Lane {
        lateral: round(-0.5 * width),
        speed_m_s,
        along: (25.0, end + speed * draft.seconds),
        gap,
        heavy,
    };
    traffic::lane(draft, dice, lane);
    // Vehicles far ahead of us that drive as we do.
    if dice.chance(0.3) {
        let lane =
            Lane { lateral: own, speed_m_s: speed * 1.1, along: (70.0, end), gap: (30.0, 90.0), heavy };
        traffic::lane(draft, dice, lane);
    }
}

/// Vehicles and people on the verge.
fn on_verge(draft: &mut Draft, dice: &mut Dice, side: Side, (inner, outer): (f64, f64)) {
    for _ in 0..dice.whole(1, 3) {
        let (kind, size_m, grey) = traffic::vehicle(dice, 0.1, 0.0);
        let lateral = side.sign() * (inner + 0.25 + 0.5 * size_m[0]);
        let at = (dice.between(15.0, draft.way_m() + 60.0), round(lateral));
        let yaw_deg = if dice.chance(if side == Side::Left { 0.8 } else { 0.1 }) { 180.0 } else { 0.0 };
        draft.place(Thing { kind, size_m, at, motion: Motion::Still, yaw_deg, grey });
    }
    let count = dice.whole(0, 3);
    traffic::walkers(draft, dice, side, (inner, outer), count);
}

/// Rails, posts, banks, hedges, fences, walls and trees of one side.
fn roadside(draft: &mut Draft, dice: &mut Dice, side: Side, verge: (f64, f64), beyond: Beyond) {
    let end = draft.way_m() + BEYOND_M;
    let start = -30.0;
    let outer = draft.outer(side) - 24.0;
    let rail = dice.chance(0.3);
    if rail {
        let from = dice.between(-30.0, 60.0);
        let along = (from, round((from + dice.between(40.0, 200.0)).min(end)));
        draft.row(Row {
            kind: BesideKind::GuardRail,
            side,
            out_m: round(verge.0 + 0.8),
            along,
            height_m: 0.75,
            grey: 100.0,
        });
    }
    let border = match beyond {
        Beyond::Bank => Some((BesideKind::Bank, dice.between(0.8, 2.6))),
        _ => dice.weighted(&[
            (None, 0.35),
            (Some((BesideKind::Hedge, 1.4)), 0.2),
            (Some((BesideKind::Fence, 1.1)), 0.2),
            (Some((BesideKind::StoneWall, 0.9)), 0.15),
        ]),
    };
    let mut free = outer + 0.4;
    if let Some((kind, height_m)) = border {
        let height_m = round(height_m * dice.between(0.8, 1.3));
        let mut at = start + dice.between(0.0, 40.0);
        while at < end {
            let long = dice.between(30.0, 120.0);
            let along = (round(at), round((at + long).min(end)));
            draft.row(Row {
                kind,
                side,
                out_m: round(outer + 0.3),
                along,
                height_m,
                grey: dice.between(62.0, 105.0),
            });
            at += long + dice.pick(&[1.0, 5.0, 25.0]);
        }
        free += if kind == BesideKind::Bank { 6.5 } else { 1.4 };
    }
    posts(draft, dice, side, verge.0);
    if dice.chance(0.2) {
        houses(draft, dice, side, free + 6.0);
    }
    let dense = dice.between(0.2, 1.0);
    let near = (free, free + dice.between(3.0, 9.0));
    green(draft, dice, side, near, dense);
    green(draft, dice, side, (free + 9.0, free + 20.0), dense);
}

/// Delineators and signs beside the asphalt's edge.
fn posts(draft: &mut Draft, dice: &mut Dice, side: Side, edge: f64) {
    let end = draft.way_m() + BEYOND_M;
    let start = -30.0;
    if dice.chance(0.7) {
        let spacing = dice.pick(&[25.0, 33.0, 50.0]);
        let mut at = start + dice.between(0.0, spacing);
        while at < end {
            let along = (round(at), round(at + 1.0));
            let row = Row {
                kind: BesideKind::Poles,
                side,
                out_m: round(edge + 0.45),
                along,
                height_m: 1.0,
                grey: 100.0,
            };
            draft.single(row, 0.0);
            at += spacing;
        }
    }
    for _ in 0..dice.whole(0, 3) {
        let at = dice.between(5.0, end - 40.0);
        let along = (round(at), round(at + 1.0));
        let row = Row {
            kind: BesideKind::Signs,
            side,
            out_m: round(edge + 0.7),
            along,
            height_m: 2.5,
            grey: 100.0,
        };
        draft.single(row, 0.0);
    }
}
