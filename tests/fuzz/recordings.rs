//! Recordings in MCAP: their index, their images and calibrations, and files that are cut off.

use super::harness::{fuzz, written};
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

/// A recording of three pairs.
fn recording(form: ImageForm, compression: Option<Compression>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    // Without checksums, or every change would end there.
    let options = WriteOptions::new().compression(compression).chunk_size(Some(400));
    let options = options.calculate_chunk_crcs(false).calculate_data_section_crc(false);
    let mut writer =
        options.calculate_summary_section_crc(false).create(&mut bytes).expect("a recording begins");
    let rig = Rig { focal_px: 20.0, baseline_m: 0.12, cx_px: 8.0, cy_px: 4.0 };
    for sequence in 0..3 {
        let stamp = Stamp { sequence, time_ns: 1_700_000_000_000_000_000 + sequence * 80_000_000 };
        let pixels: Vec<u8> = (0..SIZE.0 * SIZE.1).map(|i| (i * (3 + sequence as u32)) as u8).collect();
        let sides = [Side::Left, Side::Right];
        let images = sides.map(|side| image(stamp, side, form, &pixels, SIZE).expect("an image is encoded"));
        let calibrations = geometry(stamp, &rig, SIZE);
        for message in images.iter().chain(&calibrations) {
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
            writer.write_to_known_channel(&header, &message.data).expect("a message");
        }
    }
    writer.finish().expect("a recording ends");
    drop(writer);
    bytes.into_inner()
}

#[test]
fn recording_file() {
    let seeds = vec![
        recording(ImageForm::Raw, None),
        recording(ImageForm::Png, None),
        recording(ImageForm::Jpeg, Some(Compression::Lz4)),
        recording(ImageForm::Raw, Some(Compression::Zstd)),
    ];
    fuzz("recordings::recording_file", seeds, 65_536, |input, path| {
        let mut source = match RecordingSource::open(&written(path, "mcap", input)) {
            Err(error) => return error.to_string(),
            Ok(source) => source,
        };
        let (width, height) = source.size();
        // A recording that was accepted can be read, or the error says why not.
        let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
        let count = source.count().unwrap_or(0).min(8);
        let answers: Vec<String> = (0..count)
            .map(|i| source.read(i, &mut left, &mut right).map_or_else(|e| e.to_string(), |()| "ok".into()))
            .collect();
        format!("{count} pairs, cut {}, {}", source.cut().is_some(), answers.join("; "))
    });
}
