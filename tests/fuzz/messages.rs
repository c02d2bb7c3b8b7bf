//! Messages: headers and payloads as a broken or hostile process might leave them in shared memory.

use super::harness::fuzz;
use fastrand::Rng;
use messages::header::{Header, Kind, Stamp};
use messages::{command, depth, obstacles, pair, pipeline, regions, report, status};
use std::path::Path;

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

/// Reads a message as its reader does, and everything in it.
fn read(bytes: &[u8], _: &Path) -> String {
    let Some((kind, header, memory, length)) = message(bytes) else { return "short".into() };
    let payload: &[u8] = &bytemuck::cast_slice::<u64, u8>(&memory)[..length];
    let said = match kind {
        Kind::Pair => pair::view(&header, payload).map(|p| p.left.len() + p.right.len()),
        Kind::Depth => depth::view(&header, payload).map(|d| {
            assert_eq!(d.disparity.len(), d.confidence.len());
            d.left.len()
        }),
        Kind::Regions => regions::view(&header, payload).map(|r| {
            for region in r.regions {
                let [x, y, width, height] = region.bounds;
                assert!(x + width <= header.width && y + height <= header.height, "{region:?}");
                if let Some(crop) = r.crop(region) {
                    assert_eq!(crop.len(), region.crop[2] as usize * region.crop[3] as usize);
                }
            }
            r.profile_px.len().min(2) + r.regions.len()
        }),
        Kind::Obstacles => obstacles::view(&header, payload).map(|o| o.obstacles.len()),
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
    match said {
        Ok(_) => format!("ok {kind:?}"),
        Err(error) => format!("{kind:?} {error}"),
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
    let mut writer = regions::Writer::new(payload, road, &profile, &[20.0, 30.0], 3).expect("it fits");
    for _ in 0..3 {
        let region = regions::RegionRecord {
            disparity_px: 4.0,
            bounds: [2, 2, 5, 4],
            crop: [1, 1, 6, 5],
            ..Default::default()
        };
        writer.push(region, (0..5).map(|row| &noise[row * 6..(row + 1) * 6]));
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
    // Every seed is valid.
    for seed in seeds() {
        assert!(read(&seed, Path::new("")).starts_with("ok"), "{}", read(&seed, Path::new("")));
    }
    fuzz("messages::message_views", seeds(), 1 << 16, read);
}
