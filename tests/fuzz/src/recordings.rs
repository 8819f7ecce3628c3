//! A recording: the first byte says whether the rest is a file, or records that are put into a block with right
//! checks, so that what lies behind those is reached too.

use std::io::Cursor;

use pairmaskd::recording::{
    Event, MOST_PAYLOAD_BYTES, Record, RecordFile, RecordSettings, Recording,
};

/// Bytes of the header of a record, and where its check begins.
const HEADER_BYTES: usize = 40;
const CHECKED_FROM: usize = 8;

pub fn decode(data: &[u8]) {
    let Some((kind, rest)) = data.split_first() else { return };
    let records = if kind % 2 == 0 { read(rest) } else { read(&file_of(rest)) };
    if records.is_empty() {
        return;
    }
    for record in &records {
        if let Event::Request { payload, .. } = &record.event {
            assert!(payload.len() <= MOST_PAYLOAD_BYTES);
        }
    }
    assert!(read(&written(&records)) == records, "written, and read again");
}

/// The records of a file up to the first that is wrong.
fn read(file: &[u8]) -> Vec<Record> {
    let Ok(mut recording) = Recording::open(Cursor::new(file)) else { return Vec::new() };
    let mut records = Vec::new();
    while let Ok(Some(block)) = recording.next_block() {
        records.extend(block);
    }
    records
}

fn written(records: &[Record]) -> Vec<u8> {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let settings = RecordSettings { file: file.path().to_owned(), most_bytes: u64::MAX };
    let mut writer = RecordFile::create(&settings).expect("a recording");
    for record in records {
        writer.write(record).expect("some bytes");
    }
    writer.flush().expect("some bytes");
    std::fs::read(file.path()).expect("what was written")
}

/// A recording of one block, whose records have the checks of what is in them.
fn file_of(mut rest: &[u8]) -> Vec<u8> {
    let (mut bytes, mut count) = (Vec::new(), 0u32);
    while let Some((header, behind)) = rest.split_at_checked(HEADER_BYTES) {
        let mut header = header.to_vec();
        // A record that leaves the input has what is left of that.
        let asked = u32::from_le_bytes([header[0], header[1], header[2], header[3]]) as usize;
        let (body, behind) = behind.split_at(asked.min(behind.len()));
        header[..4].copy_from_slice(&(body.len() as u32).to_le_bytes());
        let crc = crc32fast::hash(&[&header[CHECKED_FROM..], body].concat());
        header[4..CHECKED_FROM].copy_from_slice(&crc.to_le_bytes());
        bytes.extend(header);
        bytes.extend_from_slice(body);
        count += 1;
        rest = behind;
    }
    let packed = lz4_flex::block::compress(&bytes);
    let mut file = b"PMRD\x01\0\0\0".to_vec();
    file.resize(32, 0);
    file.extend(b"PMBL");
    for number in [packed.len() as u32, bytes.len() as u32, count] {
        file.extend(number.to_le_bytes());
    }
    file.extend(packed);
    file
}
