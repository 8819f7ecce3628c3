//! Files and texts: the first byte says which, the rest is one.

use std::fmt::Display;
use std::io::Write;
use std::str::FromStr;

use pairmask::Backend;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::{Aabb, EncodingChoice, EngineChoice, Sphere};
use pairmask_transport::{DaemonRecord, StatusFile};
use pairmask_wire::{InstanceName, SceneName};
use pairmaskd::audit::AuditRate;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::object_files::{FileObject, Format, ObjectFile, write_objects};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::GpuChoices;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene;

use crate::scene_file;

pub fn decode(data: &[u8]) {
    let Some((kind, rest)) = data.split_first() else { return };
    let text = String::from_utf8_lossy(rest);
    match kind % 12 {
        0 => {
            let Some(record) = DaemonRecord::parse(&text) else { return };
            assert_eq!(DaemonRecord::parse(&record.to_string()), Some(record));
        }
        1 => {
            let Some(file) = StatusFile::parse(rest) else { return };
            assert!(rest.len() >= size_of_val(&file.body));
        }
        2 => {
            reads_back::<InstanceName>(&text);
            reads_back::<SceneName>(&text);
        }
        3 => match Config::parse(&text) {
            Ok(config) => assert!(config == config.clone()),
            Err(what) => assert!(!what.contains('\n'), "more than a line: {what}"),
        },
        4 => options(&text),
        5 => objects::<Aabb>(rest),
        6 => objects::<Sphere>(rest),
        7 => scene_file::decode(rest),
        8 => converted::<Aabb>(rest, Format::Text),
        9 => converted::<Aabb>(rest, Format::Csv),
        10 => converted::<Aabb>(rest, Format::Npy),
        _ => converted::<Sphere>(rest, Format::Npy),
    }
}

/// A value that was read is read again from what it is shown as.
fn reads_back<T: FromStr<Err: Display> + Display + PartialEq>(text: &str) {
    match text.parse::<T>() {
        Ok(value) => {
            let again = value.to_string().parse::<T>();
            assert!(again.is_ok_and(|again| again == value), "{value}");
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn options(text: &str) {
    reads_back::<EngineChoice>(text);
    reads_back::<EncodingChoice>(text);
    let _ = (text.parse::<AvailableIsa>(), text.parse::<Backend>(), text.parse::<AuditRate>());
    let _ = (text.parse::<GpuChoices>(), text.parse::<PrecisionChoice>());
    let _ = text.parse::<scene::SceneName>();
    let numbers = (whole_number::<u64>(text), whole_number::<std::num::NonZeroU16>(text));
    if let (Ok(wide), Ok(narrow)) = numbers {
        assert_eq!(wide, u64::from(narrow.get()));
    }
}

fn objects<T: FileObject>(bytes: &[u8]) {
    let file = file_of(bytes);
    match ObjectFile::<T>::open_as(file.path(), Format::Raw) {
        Ok(objects) => {
            let read = objects.read().expect("what is there");
            assert_eq!(bytemuck::cast_slice::<T, u8>(&read), bytes);
        }
        Err(error) => assert!(!bytes.len().is_multiple_of(size_of::<T>()), "{error:?}"),
    }
}

/// What was read is written, and read again from that: the same numbers.
fn converted<T: FileObject>(bytes: &[u8], format: Format) {
    let open = |bytes: &[u8]| ObjectFile::<T>::open_as(file_of(bytes).path(), format);
    match open(bytes) {
        Ok(objects) => {
            let read = objects.read().expect("what is there");
            assert!(read.len() <= bytes.len());
            let mut written = Vec::new();
            write_objects(&mut written, format, &read).expect("memory");
            let again = open(&written).expect("what was written").read().expect("what is there");
            let numbers = |objects: &[T]| {
                let numbers: &[f32] = bytemuck::cast_slice(objects);
                // Text keeps that a number is NaN, and not which one.
                let bits = numbers.iter().map(|x| if x.is_nan() { u32::MAX } else { x.to_bits() });
                bits.collect::<Vec<_>>()
            };
            assert_eq!(numbers(&again), numbers(&read));
        }
        Err(error) => assert!(!error.to_string().contains('\n'), "more than a line: {error}"),
    }
}

fn file_of(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(bytes).expect("some bytes");
    file
}
