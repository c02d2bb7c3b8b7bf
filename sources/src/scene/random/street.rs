//! City streets and suburbs.

use super::dice::Dice;
use super::draft::{Draft, Row};
use super::traffic::{self, BEYOND_M, Lane, Pace, Parking, TRAFFIC_BEYOND_M, round};
use crate::scene::file::BesideKind;
use crate::scene::strip::{Cover, Side};

/// Both sides.
const SIDES: [Side; 2] = [Side::Left, Side::Right];

/// Where rows begin, in metres along the road: behind us.
const START_M: f64 = -30.0;

/// The width of a parking strip, in metres.
const PARKING_M: f64 = 2.15;

/// A street's lanes: sets edges, markings and our own lane, and returns the lanes' middles on the left and on the right, and
/// the outer edges of the parking strips, where there are any.
fn lanes(
    draft: &mut Draft,
    dice: &mut Dice,
    width: f64,
    count: usize,
    parking: [bool; 2],
) -> ([Vec<f64>; 2], [f64; 2]) {
    let middle = |k: usize| round((k as f64 + 0.5) * width);
    let all = round(count as f64 * width);
    let outer = parking.map(|is| round(all + if is { PARKING_M } else { 0.3 }));
    draft.edges = (-outer[0], outer[1]);
    if dice.chance(0.75) {
        draft.lines.1 = vec![0.0];
        for k in 1..count {
            draft.lines.1.extend([-round(k as f64 * width), round(k as f64 * width)]);
        }
    }
    if dice.chance(0.4) {
        draft.lines.0 = vec![-all, all];
    }
    let own = dice.whole(0, count - 1);
    draft.lateral = vec![(0.0, round(middle(own) + dice.between(-0.05, 0.1)))];
    ([(0..count).map(|k| -middle(k)).collect(), (0..count).map(middle).collect()], outer)
}

/// Traffic of a street: a vehicle ahead, oncoming ones, those in other lanes.
fn traffic_of(draft: &mut Draft, dice: &mut Dice, lanes: &[Vec<f64>; 2], speed: f64, buses: f64) {
    let own = draft.lateral[0].1;
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    if dice.chance(0.45) {
        let range = (dice.between(6.0, 9.0), dice.between(18.0, 40.0));
        traffic::lead(draft, dice, range, (0.05, buses));
    }
    for &lateral in &lanes[1] {
        if (lateral - own).abs() > 1.0 {
            let speed_m_s = speed * dice.between(0.6, 1.15);
            let along = (-20.0, end);
            traffic::lane(
                draft,
                dice,
                Lane { lateral, speed_m_s, along, gap: (10.0, 60.0), heavy: (0.08, buses) },
            );
        }
    }
    for &lateral in &lanes[0] {
        let speed_m_s = -speed * dice.between(0.6, 1.2);
        let along = (15.0, end + speed * draft.seconds);
        let gap = dice.pick(&[(8.0, 40.0), (20.0, 90.0), (60.0, 200.0)]);
        traffic::lane(draft, dice, Lane { lateral, speed_m_s, along, gap, heavy: (0.06, buses) });
    }
}

/// People who cross: before us where we stop, and elsewhere.
fn crossings(draft: &mut Draft, dice: &mut Dice, stop: Option<(f64, f64)>, count: usize) {
    let sides = (round(draft.edges.0 - 0.9), round(draft.edges.1 + 0.9));
    if let Some((time_s, along_m)) = stop {
        for _ in 0..6 {
            let at = round(along_m + dice.between(5.0, 9.0));
            if traffic::crossing(draft, dice, (time_s, at), sides) {
                break;
            }
        }
    }
    for _ in 0..count {
        let time_s = dice.between(1.0, draft.seconds);
        let at = round(draft.along_m(time_s) + dice.between(10.0, 40.0));
        traffic::crossing(draft, dice, (time_s, at), sides);
    }
}

/// A city street.
pub fn city(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "city");
    let pace = dice.weighted(&[(Pace::Steady, 0.3), (Pace::Varied, 0.35), (Pace::Stop, 0.35)]);
    let speed = dice.between(5.0, 12.0);
    let stop = traffic::drive_at(draft, speed, pace);
    let is_bent = dice.chance(0.45);
    traffic::course(
        draft,
        if is_bent { dice.between(3.0, 14.0) } else { 0.0 },
        if dice.chance(0.4) { 3.0 } else { 0.0 },
    );
    let count = dice.weighted(&[(1, 0.75), (2, 0.25)]);
    let parking = [dice.chance(0.8), dice.chance(0.8)];
    let width = dice.between(2.9, 3.4);
    let (lanes, outer) = lanes(draft, &mut dice, width, count, parking);
    let kerb = dice.between(0.06, 0.17);
    let mut pavements = [(0.0, 0.0); 2];
    for (k, side) in SIDES.into_iter().enumerate() {
        draft.strip(side, 0.15, (kerb, 0.0), Cover::Stone);
        let wide = dice.between(2.2, 4.8);
        pavements[k] = draft.strip(side, wide, (0.0, round(0.015 * wide)), Cover::Pavement);
        if dice.chance(0.25) {
            draft.strip(side, dice.between(2.0, 5.0), (0.02, 0.0), Cover::Lawn);
        }
        draft.strip(side, 14.0, (0.0, 0.0), Cover::Earth);
    }
    draft.drive();
    traffic_of(draft, &mut dice, &lanes, speed, 0.08);
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    for (k, side) in SIDES.into_iter().enumerate() {
        fronts(draft, &mut dice, side, pavements[k].1);
        if parking[k] {
            let row =
                Parking { side, out_m: outer[k], along: (START_M, end), share: dice.between(0.45, 0.95) };
            traffic::park(draft, &mut dice, row);
        }
        furniture(draft, &mut dice, side, pavements[k]);
    }
    crossings(draft, &mut dice, stop, 3);
    for (k, side) in SIDES.into_iter().enumerate() {
        let count = dice.whole(2, 14);
        traffic::walkers(draft, &mut dice, side, (pavements[k].0 + 1.2, pavements[k].1), count);
        let count = dice.whole(0, 6);
        traffic::clutter(draft, &mut dice, side, (pavements[k].0 + 0.2, pavements[k].1), count);
    }
}

/// A closed row of houses with some gaps, on the edge of the pavement or behind a garden with its wall, fence or hedge.
fn fronts(draft: &mut Draft, dice: &mut Dice, side: Side, pavement: f64) {
    let end = draft.way_m() + BEYOND_M;
    let garden = draft.outer(side) - 14.0 - pavement;
    if garden > 1.0 && dice.chance(0.7) {
        border(draft, dice, side, pavement + 0.15, (START_M, end));
    }
    let out_m = round(pavement + garden + 0.4);
    let mut at = START_M;
    while at < end {
        let long = dice.between(7.0, 16.0);
        let height_m = dice.between(7.0, 16.0);
        let row = Row {
            kind: BesideKind::Buildings,
            side,
            out_m,
            along: (round(at), round(at + 1.0)),
            height_m,
            grey: 100.0,
        };
        draft.single(row, long);
        // The eaves of neighbours do not touch, on the inside of bends neither.
        at += 1.35 * long + 1.6 + if dice.chance(0.12) { dice.between(4.0, 12.0) } else { 0.0 };
    }
}

/// Trees, lamps, bollards and signs between kerb and walkers.
fn furniture(draft: &mut Draft, dice: &mut Dice, side: Side, (inner, outer): (f64, f64)) {
    let end = draft.way_m() + BEYOND_M;
    let room = outer - inner;
    let put = |draft: &mut Draft, kind, out_m: f64, at: f64, height_m| {
        let along = (round(at), round(at + 1.0));
        draft.single(Row { kind, side, out_m: round(out_m), along, height_m, grey: 100.0 }, 0.0)
    };
    if dice.chance(0.6) {
        let spacing = dice.between(22.0, 34.0);
        let mut at = START_M + dice.between(0.0, spacing);
        while at < end {
            put(draft, BesideKind::Lamps, inner - 0.55, at, 6.2);
            at += spacing;
        }
    }
    if dice.chance(0.6) {
        let spacing = dice.between(9.0, 22.0);
        let mut at = START_M + dice.between(0.0, spacing);
        while at < end {
            let height = dice.between(3.4, 6.5).min((room - 0.2) / 0.5);
            if height > 2.5 {
                put(draft, BesideKind::Trees, inner + 0.3 + 0.2 * height, at, height);
            }
            at += spacing + dice.between(0.0, 4.0);
        }
    }
    if dice.chance(0.35) {
        let from = dice.between(0.0, 40.0);
        let spacing = dice.between(1.8, 4.0);
        for k in 0..dice.whole(4, 25) {
            put(draft, BesideKind::Poles, inner + 0.35, from + k as f64 * spacing, 0.95);
        }
    }
    for _ in 0..dice.whole(0, 5) {
        let at = dice.between(5.0, end - 60.0);
        put(draft, BesideKind::Signs, inner + 0.3, at, dice.between(2.4, 3.1));
    }
}

/// A hedge, wall, stone wall or fence along the road, with gateways.
pub fn border(draft: &mut Draft, dice: &mut Dice, side: Side, out_m: f64, (from, to): (f64, f64)) {
    let mut at = from;
    while at < to {
        // Each garden has its own.
        let (kind, least, most) = dice.pick(&[
            (BesideKind::Hedge, 0.7, 1.9),
            (BesideKind::Wall, 0.6, 1.9),
            (BesideKind::StoneWall, 0.4, 1.2),
            (BesideKind::Fence, 0.8, 1.7),
            (BesideKind::Hedge, 0.7, 1.9),
        ]);
        let gardens = dice.whole(1, 3);
        let (height_m, grey) = (dice.between(least, most), dice.between(58.0, 110.0));
        for _ in 0..gardens {
            let long = dice.between(7.0, 24.0);
            let along = (round(at), round(at + long));
            draft.row(Row { kind, side, out_m: round(out_m), along, height_m, grey });
            at += long + if dice.chance(0.65) { dice.between(1.4, 4.5) } else { 0.7 };
        }
        at += dice.pick(&[0.0, 0.0, 3.0, 14.0]);
    }
}

/// A suburb.
pub fn suburb(draft: &mut Draft) {
    let mut dice = Dice::new(draft.seed(), "suburb");
    let pace = dice.weighted(&[(Pace::Steady, 0.35), (Pace::Varied, 0.4), (Pace::Stop, 0.25)]);
    let speed = dice.between(5.0, 11.0);
    let stop = traffic::drive_at(draft, speed, pace);
    let bend = if dice.chance(0.6) { dice.between(3.0, 16.0) } else { 0.0 };
    let grade = if dice.chance(0.5) { dice.between(2.0, 6.0) } else { 0.0 };
    traffic::course(draft, bend, grade);
    let width = dice.between(2.75, 3.2);
    let parking = [dice.chance(0.55), dice.chance(0.6)];
    let (lanes, outer) = lanes(draft, &mut dice, width, 1, parking);
    let mut gardens = [(0.0, 0.0); 2];
    let mut walks = [None; 2];
    let kerb = dice.between(0.04, 0.2);
    for (k, side) in SIDES.into_iter().enumerate() {
        let sloped = |dice: &mut Dice, width: f64| round(width * dice.pick(&[0.0, 0.0, 0.02, 0.05, 0.1]));
        draft.strip(side, 0.13, (kerb, 0.0), Cover::Stone);
        match dice.whole(0, 3) {
            // A lawn right behind the kerb, then the pavement, or none.
            0 | 1 => {
                let wide = dice.between(1.0, 3.5);
                let rise = sloped(&mut dice, wide);
                draft.strip(side, wide, (dice.between(-0.02, 0.05), rise), Cover::Lawn);
                if dice.chance(0.6) {
                    walks[k] = Some(draft.strip(side, dice.between(1.3, 2.2), (0.0, 0.0), Cover::Pavement));
                }
            }
            _ => walks[k] = Some(draft.strip(side, dice.between(1.4, 2.6), (0.0, 0.02), Cover::Pavement)),
        }
        let wide = dice.between(4.0, 9.0);
        let rise = sloped(&mut dice, wide);
        gardens[k] = draft.strip(side, wide, (dice.pick(&[0.0, 0.02, 0.08]), rise), Cover::Lawn);
        draft.strip(side, 13.0, (0.0, 0.0), Cover::Grass);
    }
    draft.drive();
    traffic_of(draft, &mut dice, &lanes, speed, 0.02);
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    for (k, side) in SIDES.into_iter().enumerate() {
        if dice.chance(0.8) {
            border(draft, &mut dice, side, gardens[k].0 + 0.2, (START_M, draft.way_m() + BEYOND_M));
        }
        houses(draft, &mut dice, side, gardens[k].1 + 0.4);
        if parking[k] {
            let row =
                Parking { side, out_m: outer[k], along: (START_M, end), share: dice.between(0.25, 0.75) };
            traffic::park(draft, &mut dice, row);
        }
        green(draft, &mut dice, side, (draft.edge(side) + 0.3, gardens[k].0), 0.4);
        green(draft, &mut dice, side, (gardens[k].0 + 1.3, gardens[k].1 - 0.5), 0.8);
    }
    crossings(draft, &mut dice, stop, 2);
    for (k, side) in SIDES.into_iter().enumerate() {
        if let Some(walk) = walks[k] {
            let count = dice.whole(1, 7);
            traffic::walkers(draft, &mut dice, side, walk, count);
            let count = dice.whole(0, 5);
            traffic::clutter(draft, &mut dice, side, walk, count);
        }
    }
}

/// Houses with gardens between them.
pub fn houses(draft: &mut Draft, dice: &mut Dice, side: Side, out_m: f64) {
    let end = draft.way_m() + BEYOND_M;
    let mut at = START_M;
    while at < end {
        let long = dice.between(8.0, 13.0);
        let height_m = dice.between(3.2, 7.5);
        let along = (round(at), round(at + 1.0));
        let row =
            Row { kind: BesideKind::Buildings, side, out_m: round(out_m), along, height_m, grey: 100.0 };
        draft.single(row, long);
        at += 1.4 * long + dice.between(3.0, 14.0);
    }
}

/// Trees and bushes between two distances from the reference line, one every `share` × 10 to 30 m.
pub fn green(draft: &mut Draft, dice: &mut Dice, side: Side, (inner, outer): (f64, f64), share: f64) {
    let end = draft.way_m() + BEYOND_M;
    let mut at = START_M + dice.between(0.0, 15.0);
    while at < end && outer - inner > 0.8 {
        let along = (round(at), round(at + 1.0));
        let (kind, height_m) = if dice.chance(0.55) {
            (BesideKind::Trees, dice.between(3.0, 8.0))
        } else {
            (BesideKind::Bushes, dice.between(0.6, 1.6))
        };
        let reach = if kind == BesideKind::Trees { 0.16 * height_m } else { 0.75 * height_m };
        let low = inner + reach - if kind == BesideKind::Bushes { 0.5 } else { 0.0 };
        let high = (outer - reach).max(low);
        let out_m = round(dice.between(low, high));
        if dice.chance(share) && outer - inner > 2.0 * reach {
            draft.single(Row { kind, side, out_m, along, height_m, grey: 100.0 }, 0.0);
        }
        at += dice.between(6.0, 24.0);
    }
}
