//! Messages: headers and payloads as a broken or hostile process might leave them in shared memory.

use super::harness::{Format, fuzz_format};
use fastrand::Rng;
use messages::header::{Header, Kind, Stamp};
use messages::{command, depth, obstacles, pair, pipeline, regions, report, status, track};

/// Bytes of the fields of a header that anybody may write.
const HEADER_BYTES: usize = 48;

/// Kinds by their numbers in the inputs.
const KINDS: [Kind; 7] =
    [Kind::Pair, Kind::Depth, Kind::Regions, Kind::Obstacles, Kind::Report, Kind::Command, Kind::Status];

/// A message as an input: number of its kind, fields of its header, payload.
fn input(kind: usize, width: u32, height: u32, payload: &[u8]) -> Vec<u8> {
    let mut out = vec![kind as u8];
    out.extend(7_u64.to_le_bytes());
    out.extend([0; HEADER_BYTES - 16]);
    out.extend(width.to_le_bytes());
    out.extend(height.to_le_bytes());
    out.extend(payload);
    out
}

/// The message of an input, its payload aligned as shared memory is.
fn message(input: &[u8]) -> Option<(Kind, Header, Vec<u64>, usize)> {
    let (&number, rest) = input.split_first()?;
    let (fields, payload) = rest.split_first_chunk::<HEADER_BYTES>()?;
    let long = |at: usize| u64::from_le_bytes(fields[at..at + 8].try_into().expect("eight bytes"));
    let short = |at: usize| u32::from_le_bytes(fields[at..at + 4].try_into().expect("four bytes"));
    let kind = KINDS[number as usize % KINDS.len()];
    let mut header = Header::new(kind);
    header.sequence = long(0);
    header.source_ns = long(8);
    header.capture_ns = long(16);
    header.stamps = [Stamp { begin_ns: long(24), end_ns: long(32) }; pipeline::PATH_LENGTH];
    (header.width, header.height) = (short(40), short(44));
    let mut memory = vec![0_u64; payload.len().div_ceil(8)];
    bytemuck::cast_slice_mut::<u64, u8>(&mut memory)[..payload.len()].copy_from_slice(payload);
    Some((kind, header, memory, payload.len()))
}

/// Gives one field of a message another value: any, a share of its own, or one beside it.
fn change(random: &mut Rng, input: &mut [u8]) {
    let wide = random.bool();
    let size = if wide { 8 } else { 4 };
    let Some(places) = input.len().checked_sub(1).map(|bytes| bytes / size).filter(|&places| places > 0)
    else {
        return;
    };
    let at = 1 + size * random.usize(0..places);
    let field = &mut input[at..at + size];
    let share = f64::from(random.u8(..)) / 128.0;
    match (random.u8(0..6), wide) {
        (0, _) => random.fill(field),
        (1 | 2, true) => {
            let old = f64::from_le_bytes(field.try_into().expect("eight bytes"));
            field.copy_from_slice(&(old * share).to_le_bytes());
        }
        (1 | 2, false) => {
            let old = f32::from_le_bytes(field.try_into().expect("four bytes"));
            field.copy_from_slice(&(old * share as f32).to_le_bytes());
        }
        (3, true) => field.copy_from_slice(&(random.u64(..) as f64 * 1e-15).to_le_bytes()),
        (_, true) => {
            let old = u64::from_le_bytes(field.try_into().expect("eight bytes"));
            field.copy_from_slice(&old.wrapping_add(random.u64(0..5)).to_le_bytes());
        }
        (_, false) => {
            let old = u32::from_le_bytes(field.try_into().expect("four bytes"));
            field.copy_from_slice(&old.wrapping_add(random.u32(0..5)).to_le_bytes());
        }
    }
}

/// Reads a message as its reader does, and everything in it.
fn read(bytes: &[u8]) -> Result<String, String> {
    let Some((kind, header, memory, length)) = message(bytes) else { return Err("short".into()) };
    let payload: &[u8] = &bytemuck::cast_slice::<u64, u8>(&memory)[..length];
    let said = match kind {
        Kind::Pair => pair::view(&header, payload).map(|p| p.left.len() + p.right.len()),
        Kind::Depth => depth::view(&header, payload).map(|d| {
            assert_eq!(d.disparity.len(), d.confidence.len());
            d.left.len()
        }),
        Kind::Regions => regions::view(&header, payload).map(|r| {
            assert!(r.profile_px.iter().all(|v| v.is_finite() && *v >= 0.0));
            for region in &r.regions {
                let measures =
                    [region.distance_m, region.width_m, region.height_m, region.disparity_sigma_px];
                assert!(measures.iter().all(|v| (0.0..=1e4).contains(v)), "{region:?}");
                assert!(region.disparity_px > 0.0 && region.lateral_m.abs() <= 1e4, "{region:?}");
                let [x, y, width, height] = region.bounds;
                assert!(x + width <= header.width && y + height <= header.height, "{region:?}");
            }
            for track in &r.tracks {
                let measures = [track.distance_m, track.width_m, track.height_m, track.distance_sigma_m];
                assert!(measures.iter().all(|v| (0.0..=1e4).contains(v)), "{track:?}");
                assert!((0.0..=1.0).contains(&track.probability), "{track:?}");
                let [x, y, width, height] = track.bounds;
                assert!(x + width <= header.width && y + height <= header.height, "{track:?}");
                if let Some(crop) = r.crop(track) {
                    assert_eq!(crop.len(), track.crop[2] as usize * track.crop[3] as usize);
                }
            }
            r.profile_px.len().min(2) + r.regions.len() + r.tracks.len()
        }),
        Kind::Obstacles => obstacles::view(&header, payload).map(|o| {
            for obstacle in &o.obstacles {
                let measures =
                    [obstacle.distance_m, obstacle.distance_sigma_m, obstacle.width_m, obstacle.height_m];
                assert!(measures.iter().all(|v| (0.0..=1e4).contains(v)), "{obstacle:?}");
                assert!(
                    obstacle.closing_m_s.abs() <= 1e3 && obstacle.across_m_s.abs() <= 1e3,
                    "{obstacle:?}"
                );
            }
            o.obstacles.len()
        }),
        Kind::Report => report::view(&header, payload).map(|r| {
            assert!(r.role().is_some());
            r.text().len() + r.calibration.to_string().len()
        }),
        Kind::Command => command::view(&header, payload).map(|c| c.attempt as usize % 2),
        Kind::Status => status::view(&header, payload).map(|s| {
            assert!(s.processes().count() <= pipeline::Role::ALL.len());
            s.reason().len()
                + s.state_name().len()
                + s.processes().map(|(_, p)| p.state().len()).sum::<usize>()
        }),
    };
    assert!(said.is_err() || header.source_ns < 1 << 62, "{header:?}");
    match said {
        Ok(count) => Ok(format!("{kind:?} {}", count.min(8))),
        Err(error) => Err(format!("{kind:?} {error}")),
    }
}

/// A valid message of each kind.
fn seeds() -> Vec<Vec<u8>> {
    let mut random = Rng::with_seed(3);
    let (width, height) = (12_u32, 10_u32);
    let pixels = (width * height) as usize;
    let noise: Vec<u8> = std::iter::repeat_with(|| random.u8(..)).take(5 * pixels).collect();
    let mut seeds = vec![input(0, width, height, &noise[..2 * pixels]), input(1, width, height, &noise)];

    let mut memory = vec![0_u64; regions::max_payload_bytes(width as usize, height as usize).div_ceil(8)];
    let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
    let road = regions::RoadRecord { seen: 1, ..Default::default() };
    let profile = vec![1.5_f32; height as usize];
    let mut writer = regions::Writer::new(payload, road, &profile, regions::Counts { regions: 3, tracks: 3 })
        .expect("it fits");
    for _ in 0..3 {
        let bounds = [2, 2, 5, 4];
        writer.push_region(&regions::RegionRecord { disparity_px: 4.0, bounds, ..Default::default() });
        let track =
            track::TrackRecord { disparity_px: 4.0, bounds, crop: [1, 1, 6, 5], ..Default::default() };
        writer.push_track(track, (0..5).map(|row| &noise[row * 6..(row + 1) * 6]));
    }
    let length = writer.bytes();
    seeds.push(input(2, width, height, &bytemuck::cast_slice::<u64, u8>(&memory)[..length]));

    let mut memory = vec![0_u64; obstacles::payload_bytes(2) / 8];
    let obstacle = obstacles::ObstacleRecord { track: 3, bounds: [1, 1, 4, 4], ..Default::default() };
    obstacles::write(bytemuck::cast_slice_mut(&mut memory), Default::default(), &[obstacle; 2])
        .expect("it fits");
    seeds.push(input(3, width, height, bytemuck::cast_slice(&memory)));

    let mut report = report::ReportRecord::new(pipeline::Role::Road);
    report.set_health(report::Health::Unusable, "left/7.png: cannot be decoded");
    seeds.push(input(4, 0, 0, bytemuck::bytes_of(&report)));
    let command = command::CommandRecord { period_ns: 80_000_000, ..Default::default() };
    seeds.push(input(5, 0, 0, bytemuck::bytes_of(&command)));
    let mut status = status::StatusRecord::empty();
    status.processes = 5;
    status.set_reason("its time is up");
    seeds.push(input(6, 0, 0, bytemuck::bytes_of(&status)));
    seeds
}

#[test]
fn message_views() {
    let valid = seeds();
    for seed in &valid {
        assert!(read(seed).is_ok(), "{:?}", read(seed));
    }
    let generate = &mut |random: &mut Rng| valid[random.usize(0..valid.len())].clone();
    let format = Format {
        name: "messages::message_views",
        longest: 1 << 16,
        generate,
        change: |random, input, _| change(random, input),
    };
    fuzz_format(format, |input, _| read(input));
}
