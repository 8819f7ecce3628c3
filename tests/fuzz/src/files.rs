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
use pairmaskd::cli::raw_objects::{RawObject, RawObjects};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::GpuChoices;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene;

use crate::scene_file;

pub fn decode(data: &[u8]) {
    let Some((kind, rest)) = data.split_first() else { return };
    let text = String::from_utf8_lossy(rest);
    match kind % 8 {
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
        _ => scene_file::decode(rest),
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

fn objects<T: RawObject>(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(bytes).expect("some bytes");
    match RawObjects::<T>::open(file.path()) {
        Ok(objects) => {
            let read = objects.read().expect("what is there");
            assert_eq!(bytemuck::cast_slice::<T, u8>(&read), bytes);
        }
        Err(error) => assert!(!bytes.len().is_multiple_of(size_of::<T>()), "{error:?}"),
    }
}
