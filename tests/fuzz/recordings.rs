//! Recordings in MCAP: their index, their images and calibrations, and files that are cut off.

use super::containers;
use super::harness::{Format, fuzz_format, written};
use fastrand::Rng;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use perception::rig::Rig;
use sources::PairSource;
use sources::recording::RecordingSource;
use std::collections::BTreeMap;
use std::io::Cursor;
use tools::recording::ImageForm;
use tools::recording::encode::{Side, Stamp, geometry, image};

const SIZE: (u32, u32) = (16, 8);

/// A recording of up to four pairs. Now and then a message is missing, out of order, or changed within: lengths and
/// checksums of the file are right all the same.
fn some_recording(random: &mut Rng) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let form = [ImageForm::Raw, ImageForm::Png, ImageForm::Jpeg][random.usize(0..3)];
    let compression = [None, Some(Compression::Lz4), Some(Compression::Zstd)][random.usize(0..3)];
    // Mostly without checksums, or every change would end there.
    let checked = random.u8(0..4) == 0;
    let options = WriteOptions::new()
        .compression(compression)
        .use_chunks(random.u8(0..6) > 0)
        .chunk_size(Some(random.u64(100..2000)))
        .emit_message_indexes(random.u8(0..4) > 0)
        .calculate_chunk_crcs(checked)
        .calculate_data_section_crc(checked)
        .calculate_summary_section_crc(checked);
    let mut writer = options.create(&mut bytes).expect("a recording begins");
    let rig = Rig { focal_px: 20.0, baseline_m: 0.12, cx_px: 8.0, cy_px: 4.0 };
    // A share of the recordings has sound messages only.
    let damage = if random.bool() { 0 } else { random.u8(1..40) };
    for sequence in 0..random.u64(1..5) {
        let step_ns = 80_000_000 + random.u64(0..4_000_000);
        let stamp = Stamp { sequence, time_ns: 1_700_000_000_000_000_000 + sequence * step_ns };
        let pixels: Vec<u8> = (0..SIZE.0 * SIZE.1).map(|i| (i * (3 + sequence as u32)) as u8).collect();
        let sides = [Side::Left, Side::Right];
        let images = sides.map(|side| image(stamp, side, form, &pixels, SIZE).expect("an image is encoded"));
        let calibrations = geometry(stamp, &rig, SIZE);
        for message in images.iter().chain(&calibrations) {
            let mut data = message.data.to_vec();
            let is_damaged = random.u8(0..100) < damage;
            if is_damaged && random.bool() {
                continue;
            }
            if is_damaged && !data.is_empty() {
                let at = random.usize(0..data.len());
                data[at] = random.u8(..);
            }
            let schema = message.topic.schema(form);
            let id = writer.add_schema(schema.name(), schema.encoding(), schema.data()).expect("a schema");
            let channel = writer
                .add_channel(id, message.topic.name(), schema.message_encoding(), &BTreeMap::new())
                .expect("a channel");
            let header = MessageHeader {
                channel_id: channel,
                sequence: message.sequence,
                log_time: message.time_ns,
                publish_time: message.time_ns,
            };
            writer.write_to_known_channel(&header, &data).expect("a message");
        }
    }
    writer.finish().expect("a recording ends");
    drop(writer);
    bytes.into_inner()
}

#[test]
fn recording_file() {
    let mut generate = some_recording;
    let name = "recordings::recording_file";
    let format = Format { name, longest: 65_536, generate: &mut generate, change: containers::recording };
    fuzz_format(format, |input, path| {
        let mut source = RecordingSource::open(&written(path, "mcap", input)).map_err(|e| e.to_string())?;
        let (width, height) = source.size();
        // A recording that was accepted can be read, or the error says why not.
        let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
        let count = source.count().unwrap_or(0).min(8);
        let answers: Vec<String> = (0..count)
            .map(|i| source.read(i, &mut left, &mut right).map_or_else(|e| e.to_string(), |()| "ok".into()))
            .collect();
        Ok(format!("{count} pairs, cut {}, {}", source.cut().is_some(), answers.join("; ")))
    });
}
