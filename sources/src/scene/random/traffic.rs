//! Own motion, and what moves or is parked.

use super::dice::Dice;
use super::draft::{Draft, Motion, Thing};
use crate::scene::file::ObjectKind;
use crate::scene::strip::Side;

/// Greatest deceleration and acceleration of our own vehicle, in m/s².
const BRAKE_M_S2: f64 = 2.5;

/// Greatest lateral acceleration in a bend, in m/s².
const SIDEWAYS_M_S2: f64 = 2.5;

/// Everything is placed up to this distance beyond the end of our drive, in metres: farther things are not drawn.
pub const BEYOND_M: f64 = 200.0;

/// Vehicles and people are placed up to this distance beyond the end of our drive, in metres.
pub const TRAFFIC_BEYOND_M: f64 = 110.0;

/// How a drive goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// At nearly the same speed.
    Steady,
    /// Slower and faster.
    Varied,
    /// To a standstill, and on again.
    Stop,
}

/// Chooses our speed around `speed_m_s`, and returns the time and place of a stop.
pub fn drive_at(draft: &mut Draft, speed_m_s: f64, pace: Pace) -> Option<(f64, f64)> {
    let mut dice = Dice::new(draft.seed(), "speed");
    let end = draft.seconds;
    let mut stop = None;
    draft.speed = match pace {
        Pace::Steady => vec![(0.0, speed_m_s), (end, speed_m_s * dice.between(0.92, 1.06))],
        Pace::Varied => {
            let mut points = vec![(0.0, speed_m_s)];
            let mut at = dice.between(0.5, 2.5);
            while at < end {
                let (before, speed) = (points[points.len() - 1], speed_m_s * dice.between(0.55, 1.15));
                if points.len() > 1 || at > 0.0 {
                    points.push((at, before.1));
                }
                let change = ((speed - before.1).abs() / (BRAKE_M_S2 * dice.between(0.4, 0.8))).max(0.5);
                points.push((at + change, speed));
                at += change + dice.between(1.0, 4.0);
            }
            points
        }
        Pace::Stop => {
            let brake = BRAKE_M_S2 * dice.between(0.6, 0.95);
            let from = dice.between(1.5, 0.3 * end);
            let halt = from + speed_m_s / brake;
            let on = halt + dice.between(2.5, 5.0);
            stop = Some((halt, on));
            vec![
                (0.0, speed_m_s),
                (from, speed_m_s),
                (halt, 0.0),
                (on, 0.0),
                (on + speed_m_s / 1.6, speed_m_s),
            ]
        }
    };
    // To three decimals, as the file has them.
    draft.speed.iter_mut().for_each(|p| *p = (round(p.0), round(p.1)));
    stop.map(|(halt, on)| (0.5 * (halt + on), draft.along_m(halt)))
}

/// Rounds to three decimals.
pub fn round(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}

/// Chooses the course of the road: bends up to `bend_per_km`, which our speed allows, and grades up to `grade_percent`.
pub fn course(draft: &mut Draft, bend_per_km: f64, grade_percent: f64) {
    let mut dice = Dice::new(draft.seed(), "course");
    let end = draft.way_m() + BEYOND_M;
    let fastest = draft.speed.iter().fold(1.0_f64, |most, p| most.max(p.1));
    let most = bend_per_km.min(1000.0 * SIDEWAYS_M_S2 / (fastest * fastest));
    if most > 0.2 {
        let mut points = vec![(-100.0, 0.0)];
        // Total turn, in rad: the road never meets itself.
        let mut turned: f64 = 0.0;
        let mut at = dice.between(-20.0, 60.0);
        while at < end {
            let ease = dice.between(15.0, 40.0) * if most < 5.0 { 3.0 } else { 1.0 };
            let arc = dice.between(10.0, 90.0);
            let mut bend = most * dice.between(0.25, 1.0) * dice.pick(&[-1.0, 1.0]);
            if (turned + bend * (ease + arc) / 1000.0).abs() > 0.9 {
                bend = -bend;
            }
            if (turned + bend * (ease + arc) / 1000.0).abs() > 0.9 {
                bend *= 0.2;
            }
            turned += bend * (ease + arc) / 1000.0;
            for (way, value) in [(0.0, 0.0), (ease, bend), (ease + arc, bend), (2.0 * ease + arc, 0.0)] {
                points.push((round(at + way), round(value)));
            }
            at += 2.0 * ease + arc + dice.between(2.0, 80.0);
        }
        draft.bend = points;
    }
    if grade_percent > 0.0 {
        let mut grade = dice.between(-grade_percent, grade_percent);
        let mut points = vec![(-100.0, grade)];
        let mut at = dice.between(-20.0, 50.0);
        while at < end {
            let change = dice.between(-0.8, 0.8) * grade_percent;
            let ease = change.abs() * dice.between(12.0, 25.0) + 10.0;
            points.push((round(at), round(grade)));
            grade = (grade + change).clamp(-grade_percent, grade_percent);
            points.push((round(at + ease), round(grade)));
            at += ease + dice.between(20.0, 90.0);
        }
        draft.grade = points;
    }
}

/// A car or a van, seen from behind.
fn passenger(dice: &mut Dice, vans: f64) -> (ObjectKind, [f64; 3], f64) {
    let grey = dice.pick(&[30.0, 45.0, 60.0, 80.0, 95.0, 115.0, 140.0, 165.0, 190.0, 215.0]);
    if dice.chance(vans) {
        let size = [dice.between(1.88, 2.05), dice.between(1.9, 2.6), dice.between(4.7, 6.0)];
        (ObjectKind::Van, size, grey)
    } else {
        let size = [dice.between(1.65, 1.92), dice.between(1.38, 1.75), dice.between(3.6, 4.9)];
        (ObjectKind::Car, size, grey)
    }
}

/// Any vehicle: a lorry or a bus by their shares, else a car or van.
pub fn vehicle(dice: &mut Dice, lorries: f64, buses: f64) -> (ObjectKind, [f64; 3], f64) {
    if dice.chance(lorries) {
        let size = [dice.between(2.35, 2.55), dice.between(3.2, 4.0), dice.between(7.0, 15.0)];
        return (ObjectKind::Lorry, size, dice.between(70.0, 215.0));
    }
    if dice.chance(buses) {
        return (
            ObjectKind::Bus,
            [2.5, dice.between(2.95, 3.2), dice.between(9.5, 12.5)],
            dice.between(80.0, 190.0),
        );
    }
    passenger(dice, 0.2)
}

/// A lane of moving vehicles.
#[derive(Clone, Copy, Debug)]
pub struct Lane {
    /// Its middle, in metres.
    pub lateral: f64,
    /// Speed along the road, in m/s; negative towards us.
    pub speed_m_s: f64,
    /// Where the vehicles are at the start, in metres along the road.
    pub along: (f64, f64),
    /// Gaps between them, in metres.
    pub gap: (f64, f64),
    /// Shares of lorries and of buses.
    pub heavy: (f64, f64),
}

/// Fills a lane with vehicles, each where no other is.
pub fn lane(draft: &mut Draft, dice: &mut Dice, lane: Lane) {
    let mut at = lane.along.0 + dice.between(0.0, lane.gap.1);
    while at < lane.along.1 {
        let (kind, size_m, grey) = vehicle(dice, lane.heavy.0, lane.heavy.1);
        let lateral = lane.lateral + dice.between(-0.15, 0.15);
        let yaw_deg = if lane.speed_m_s < 0.0 { 180.0 } else { 0.0 };
        draft.place(Thing {
            kind,
            size_m,
            at: (at, lateral),
            motion: Motion::Even(lane.speed_m_s, 0.0),
            yaw_deg,
            grey,
        });
        at += size_m[2] + dice.between(lane.gap.0, lane.gap.1);
    }
}

/// A vehicle ahead of us in our lane, at a changing distance between two.
pub fn lead(draft: &mut Draft, dice: &mut Dice, (near, far): (f64, f64), heavy: (f64, f64)) -> bool {
    let lateral = draft.lateral[0].1;
    for _ in 0..12 {
        let (kind, size_m, grey) = vehicle(dice, heavy.0, heavy.1);
        let mut ahead = dice.between(near, far);
        let mut points = vec![[0.0, ahead, lateral]];
        let mut at = 0.0;
        while at < draft.seconds {
            at = round(at + dice.between(2.0, 5.0));
            let slowest = draft.speed_m_s(at);
            // It neither drives backwards nor falls below the least distance.
            let most = slowest.min(8.0);
            ahead = (ahead + dice.between(-most, most)).clamp(near, far);
            points.push([at, round(ahead), lateral]);
        }
        // Where we change lanes, it has gone before us.
        if draft.lateral.len() > 1 {
            return false;
        }
        let placed = draft.place(Thing {
            kind,
            size_m,
            at: (0.0, 0.0),
            motion: Motion::Ahead(points),
            yaw_deg: 0.0,
            grey,
        });
        if placed {
            return true;
        }
    }
    false
}

/// A row of parked vehicles along the road.
#[derive(Clone, Copy, Debug)]
pub struct Parking {
    /// Side of the road.
    pub side: Side,
    /// Outer edge of the strip in which they stand, from the reference line, in metres.
    pub out_m: f64,
    /// Extent along the road, in metres.
    pub along: (f64, f64),
    /// Share of the places that are taken.
    pub share: f64,
}

/// Parks vehicles along the road, with gaps.
pub fn park(draft: &mut Draft, dice: &mut Dice, row: Parking) {
    let mut at = row.along.0;
    while at < row.along.1 {
        let (kind, size_m, grey) = passenger(dice, 0.18);
        if dice.chance(row.share) {
            let gap = dice.between(0.1, 0.3);
            let backwards = if row.side == Side::Left { 0.85 } else { 0.1 };
            let yaw_deg = if dice.chance(backwards) { 180.0 } else { 0.0 };
            let lateral = round(row.side.sign() * (row.out_m - gap - 0.5 * size_m[0]));
            let thing =
                Thing { kind, size_m, at: (round(at), lateral), motion: Motion::Still, yaw_deg, grey };
            draft.place(thing);
        }
        at += size_m[2] + dice.between(0.7, 2.0);
    }
}

/// People who walk along a side of the road, between two distances from the reference line.
pub fn walkers(draft: &mut Draft, dice: &mut Dice, side: Side, (inner, outer): (f64, f64), count: usize) {
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    for _ in 0..count {
        let stands = dice.chance(0.2);
        let speed = if stands { 0.0 } else { dice.between(0.8, 1.7) * dice.pick(&[-1.0, 1.0]) };
        let yaw_deg = match (stands, speed < 0.0) {
            (true, _) => dice.between(0.0, 350.0),
            (_, true) => 180.0,
            _ => 0.0,
        };
        let lateral = side.sign() * dice.between(inner + 0.45, (outer - 0.45).max(inner + 0.46));
        let at = (dice.between(5.0, end), lateral);
        let motion = if stands { Motion::Still } else { Motion::Even(speed, 0.0) };
        let thing = Thing {
            kind: ObjectKind::Pedestrian,
            size_m: person(dice),
            at,
            motion,
            yaw_deg,
            grey: dice.between(40.0, 190.0),
        };
        draft.place(thing);
    }
}

/// Width, height and depth of a person, some of them children.
fn person(dice: &mut Dice) -> [f64; 3] {
    let height = if dice.chance(0.15) { dice.between(1.05, 1.45) } else { dice.between(1.55, 1.95) };
    [round(dice.between(0.5, 0.62) * height / 1.75), height, round(0.4 * height / 1.75)]
}

/// Someone who crosses the road `ahead_m` from us at a time, if that is possible without harm.
pub fn crossing(
    draft: &mut Draft,
    dice: &mut Dice,
    (time_s, along_m): (f64, f64),
    (left, right): (f64, f64),
) -> bool {
    let size_m = person(dice);
    let speed = dice.between(1.0, 1.8);
    let to_right = dice.chance(0.5);
    let (from, to) = if to_right { (left, right) } else { (right, left) };
    let way = (to - from).abs() / speed;
    let start = round((time_s - dice.between(0.3, 0.7) * way).max(0.0));
    let points = vec![
        [0.0, along_m, from],
        [start.max(0.01), along_m, from],
        [round(start + way).max(0.02), along_m, to],
    ];
    let yaw_deg = if to_right { 90.0 } else { 270.0 };
    draft.place(Thing {
        kind: ObjectKind::Pedestrian,
        size_m,
        at: (along_m, from),
        motion: Motion::Path(points),
        yaw_deg,
        grey: dice.between(40.0, 190.0),
    })
}

/// Cyclists along a lateral position.
pub fn cyclists(draft: &mut Draft, dice: &mut Dice, lateral: f64, towards_us: bool, count: usize) {
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    for _ in 0..count {
        let speed = dice.between(3.5, 7.0) * if towards_us { -1.0 } else { 1.0 };
        let at = (dice.between(8.0, end), round(lateral + dice.between(-0.15, 0.15)));
        let thing = Thing {
            kind: ObjectKind::Cyclist,
            size_m: [0.6, dice.between(1.6, 1.85), 1.75],
            at,
            motion: Motion::Even(speed, 0.0),
            yaw_deg: if towards_us { 180.0 } else { 0.0 },
            grey: dice.between(40.0, 190.0),
        };
        draft.place(thing);
    }
}

/// Small things that stand about, between two distances from the reference line: bins, boxes, parked bicycles.
pub fn clutter(draft: &mut Draft, dice: &mut Dice, side: Side, (inner, outer): (f64, f64), count: usize) {
    let end = draft.way_m() + TRAFFIC_BEYOND_M;
    for _ in 0..count {
        let (kind, size_m, yaw_deg) = if dice.chance(0.5) {
            (ObjectKind::Bicycle, [0.5, 1.05, 1.75], dice.pick(&[0.0, 20.0, 90.0, 180.0]))
        } else {
            let size = [dice.between(0.45, 0.8), dice.between(0.6, 1.2), dice.between(0.45, 0.8)];
            (ObjectKind::Block, size, 0.0)
        };
        let reach = if yaw_deg == 90.0 { 0.9 } else { 0.45 };
        let lateral = side.sign() * dice.between(inner + reach, (outer - reach).max(inner + reach + 0.01));
        let thing = Thing {
            kind,
            size_m,
            at: (dice.between(4.0, end), round(lateral)),
            motion: Motion::Still,
            yaw_deg,
            grey: dice.between(40.0, 190.0),
        };
        draft.place(thing);
    }
}
