//! Car parks.

use super::dice::Dice;
use super::draft::{Draft, Motion, Row, Thing};
use super::street::{border, green};
use super::traffic::{self, BEYOND_M, Lane, Pace, round, vehicle};
use crate::scene::file::BesideKind;
use crate::scene::strip::{Cover, Side};

/// Length of a bay, in metres.
const BAY_M: f64 = 5.1;

/// A car park: we drive along an aisle between cars that stand across.
pub fn car_park(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "car park");
    let pace = dice.weighted(&[(Pace::Steady, 0.4), (Pace::Varied, 0.35), (Pace::Stop, 0.25)]);
    let speed = dice.between(1.6, 4.2);
    let stop = traffic::drive_at(draft, speed, pace);
    traffic::course(draft, 0.0, if dice.chance(0.25) { 2.0 } else { 0.0 });
    let aisle = dice.between(3.1, 3.7);
    let rows = [dice.whole(1, 2), dice.whole(1, 2)];
    let reach = rows.map(|rows| round(aisle + rows as f64 * (BAY_M + 0.2) + 0.5));
    draft.edges = (-reach[0], reach[1]);
    draft.lateral = vec![(0.0, dice.between(1.2, 0.5 * aisle))];
    for side in [Side::Left, Side::Right] {
        draft.strip(side, 0.15, (dice.between(0.06, 0.16), 0.0), Cover::Stone);
        draft.strip(side, dice.between(2.0, 6.0), (0.0, dice.between(0.0, 0.2)), Cover::Lawn);
        draft.strip(side, 20.0, (0.0, 0.0), Cover::Grass);
    }
    draft.drive();
    if dice.chance(0.35) {
        let lane = Lane {
            lateral: -round(0.5 * aisle),
            speed_m_s: -dice.between(1.5, 3.5),
            along: (15.0, 140.0),
            gap: (15.0, 60.0),
            heavy: (0.0, 0.0),
        };
        traffic::lane(draft, &mut dice, lane);
    }
    if dice.chance(0.25) {
        traffic::lead(draft, &mut dice, (7.0, 16.0), (0.0, 0.0));
    }
    if let Some((time_s, along_m)) = stop {
        for _ in 0..6 {
            let at = round(along_m + dice.between(4.5, 8.0));
            if traffic::crossing(draft, &mut dice, (time_s, at), (-aisle, aisle)) {
                break;
            }
        }
    }
    let end = draft.way_m() + 90.0;
    for (k, side) in [Side::Left, Side::Right].into_iter().enumerate() {
        for row in 0..rows[k] {
            let share = dice.between(0.35, 0.95);
            bays(draft, &mut dice, side, aisle + row as f64 * (BAY_M + 0.2), end, share);
        }
        lamps(draft, &mut dice, side, aisle + BAY_M, end);
        traffic::walkers(draft, &mut dice, side, (aisle - 1.1, aisle + 0.3), 5);
        traffic::clutter(draft, &mut dice, side, (aisle, aisle + BAY_M), 6);
        let outer = draft.edge(side);
        let lawn = draft.outer(side) - 20.0;
        if dice.chance(0.75) {
            border(draft, &mut dice, side, outer + 0.6, (-30.0, draft.way_m() + BEYOND_M));
        }
        green(draft, &mut dice, side, (outer + 1.8, lawn + 2.0), 0.7);
        if dice.chance(0.6) {
            hall(draft, &mut dice, side, lawn + 4.0);
        }
        green(draft, &mut dice, side, (lawn + 3.0, lawn + 18.0), 0.9);
    }
}

/// Cars across the aisle, in bays from `inner` on.
fn bays(draft: &mut Draft, dice: &mut Dice, side: Side, inner: f64, end: f64, share: f64) {
    let pitch = dice.between(2.7, 3.0);
    let mut at = -20.0 + dice.between(0.0, 2.0);
    if dice.chance(0.8) {
        draft.paint_bays(side, (inner, inner + BAY_M), at, pitch);
    }
    while at < end {
        let (kind, mut size_m, grey) = vehicle(dice, 0.0, 0.0);
        size_m[2] = size_m[2].min(BAY_M - 0.1);
        if dice.chance(share) {
            // Its rear or its front towards the aisle.
            let yaw_deg = if dice.chance(0.6) { 90.0 } else { 270.0 };
            let lateral = side.sign() * (inner + 0.5 * BAY_M + dice.between(-0.1, 0.1));
            let along = at + 0.5 * (pitch - size_m[0]) + dice.between(-0.1, 0.1);
            let at = (round(along), round(lateral));
            draft.place(Thing { kind, size_m, at, motion: Motion::Still, yaw_deg, grey });
        }
        at += pitch;
    }
}

fn lamps(draft: &mut Draft, dice: &mut Dice, side: Side, out_m: f64, end: f64) {
    let mut at = dice.between(-10.0, 20.0);
    while at < end {
        let along = (round(at), round(at + 1.0));
        let row = Row {
            kind: BesideKind::Lamps,
            side,
            out_m: round(out_m - 0.8),
            along,
            height_m: 6.5,
            grey: 100.0,
        };
        draft.single(row, 0.0);
        at += dice.between(14.0, 30.0);
    }
}

/// Large buildings behind.
fn hall(draft: &mut Draft, dice: &mut Dice, side: Side, out_m: f64) {
    let mut at = dice.between(-20.0, 30.0);
    while at < draft.way_m() + BEYOND_M {
        let (long, height_m) = (dice.between(15.0, 29.0), dice.between(4.5, 9.0));
        let along = (round(at), round(at + 1.0));
        let row =
            Row { kind: BesideKind::Buildings, side, out_m: round(out_m), along, height_m, grey: 100.0 };
        draft.single(row, long);
        at += long + dice.between(2.0, 40.0);
    }
}
