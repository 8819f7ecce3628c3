//! Constants on disk: one file a machine in the user's cache directory.
//!
//! `pairmaskd calibrate` writes it; daemons and in-process sessions read it. It is input from
//! outside: whatever it holds, the worst that comes of it is a slow plan, and what cannot be used is
//! reported and ignored.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::calibration::{Calibration, ThreadCost};
use super::machine::MachineKey;
use super::term::Term;
use crate::engine::{EngineName, Isa};

/// Version of the file and of the cost model: one more whenever a term is added, or comes to mean
/// something else.
pub const CALIBRATION_VERSION: u32 = 2;
/// Bytes of the largest file that is read: 30 times what one has.
const MOST_BYTES: u64 = 65_536;
/// The longest time that a unit of work may have, ns: a frame, or a fan-out, of 0.1 s.
const MOST_NS: f64 = 1.0e8;

/// Why a file's constants are not used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// It cannot be read.
    #[error("{0}")]
    Read(#[from] io::Error),
    /// It is longer than any calibration.
    #[error("it is longer than {MOST_BYTES} bytes")]
    TooLong,
    /// It is not TOML, or has other fields.
    #[error("it is no calibration: {}", .0.message())]
    Syntax(#[from] Box<toml::de::Error>),
    /// Another release wrote it, whose engines take other times.
    #[error("version {version} of pairmask {release} wrote it: run `pairmaskd calibrate` again")]
    Stale {
        /// Version of the file.
        version: u32,
        /// Release of pairmask.
        release: String,
    },
    /// It was measured on another machine.
    #[error("it is of another machine ({machine})")]
    Foreign {
        /// That machine's key.
        machine: String,
    },
    /// A constant is missing.
    #[error("it lacks `{name}`")]
    Missing {
        /// Which one.
        name: &'static str,
    },
    /// A constant is none.
    #[error("`{name}` is {value}, which is not from 0 to {most}")]
    Range {
        /// Which one.
        name: String,
        /// What the file says.
        value: f64,
        /// The largest that may be.
        most: f64,
    },
}

/// What a file holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Document {
    version: u32,
    release: String,
    machine: String,
    /// By [`Term`].
    ns: BTreeMap<String, f64>,
    /// By engine.
    threads: BTreeMap<String, Threads>,
    /// Of a client that visits pairs.
    visit: Threads,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Threads {
    serial_share: f64,
    fan_out_ns: f64,
}

impl Threads {
    const fn of(ThreadCost { serial_share, fan_out_ns }: ThreadCost) -> Self {
        Self { serial_share, fan_out_ns }
    }

    fn checked(&self) -> Result<ThreadCost, CalibrationError> {
        Ok(ThreadCost {
            serial_share: within("serial-share", self.serial_share, 1.0)?,
            fan_out_ns: within("fan-out-ns", self.fan_out_ns, MOST_NS)?,
        })
    }
}

/// The version alone, which other versions have too.
#[derive(Deserialize)]
struct Head {
    version: u32,
    #[serde(default)]
    release: String,
}

/// The text of a file.
pub fn encode(calibration: &Calibration, machine: &MachineKey) -> String {
    let ns = Term::ALL.map(|term| (term.to_string(), calibration.ns(term)));
    let threads = EngineName::CPU
        .map(|engine| (engine.to_string(), Threads::of(calibration.threads_of(engine))));
    let document = Document {
        version: CALIBRATION_VERSION,
        release: env!("CARGO_PKG_VERSION").to_owned(),
        machine: machine.to_string(),
        ns: ns.into(),
        threads: threads.into(),
        visit: Threads::of(calibration.visit_threads),
    };
    let head = "# Constants of the plan's cost model, by `pairmaskd calibrate`. ns: each unit of work on one\n# thread.\n";
    // Strings, numbers and maps of them always have a TOML form.
    head.to_owned() + &toml::to_string(&document).unwrap_or_default()
}

/// The constants of a file's text, for `machine` and no other.
///
/// # Errors
/// [`CalibrationError`]; never a panic, whatever the text.
pub fn decode(text: &str, machine: &MachineKey) -> Result<Calibration, CalibrationError> {
    let head: Head = toml::from_str(text).map_err(Box::new)?;
    if head.version != CALIBRATION_VERSION || head.release != env!("CARGO_PKG_VERSION") {
        return Err(CalibrationError::Stale { version: head.version, release: head.release });
    }
    let document: Document = toml::from_str(text).map_err(Box::new)?;
    if document.machine != machine.as_str() {
        return Err(CalibrationError::Foreign { machine: document.machine });
    }
    let mut calibration = Calibration::built_in(Isa::best());
    for term in Term::ALL {
        let name = term.as_str();
        let value = *document.ns.get(name).ok_or(CalibrationError::Missing { name })?;
        calibration.ns[term.index()] = within(name, value, MOST_NS)?;
    }
    for (engine, cost) in EngineName::CPU.into_iter().zip(&mut calibration.threads) {
        let name = engine.as_str();
        let found = document.threads.get(name).ok_or(CalibrationError::Missing { name })?;
        *cost = found.checked()?;
    }
    calibration.visit_threads = document.visit.checked()?;
    Ok(calibration)
}

/// A finite number from 0 to `most`.
fn within(name: &str, value: f64, most: f64) -> Result<f64, CalibrationError> {
    if (0.0..=most).contains(&value) {
        return Ok(value);
    }
    Err(CalibrationError::Range { name: name.to_owned(), value, most })
}

/// Reads a file.
///
/// # Errors
/// [`CalibrationError`].
pub fn load(path: &Path, machine: &MachineKey) -> Result<Calibration, CalibrationError> {
    let mut text = String::new();
    let read = fs::File::open(path)?.take(MOST_BYTES + 1).read_to_string(&mut text)?;
    if read as u64 > MOST_BYTES {
        return Err(CalibrationError::TooLong);
    }
    decode(&text, machine)
}

/// Writes a file: beside it first, then renamed, so that a reader sees the old one or the new one
/// and never a part.
///
/// # Errors
/// As the file system has it.
pub fn store(path: &Path, calibration: &Calibration, machine: &MachineKey) -> io::Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)?;
    }
    let beside = path.with_extension(format!("{}.tmp", std::process::id()));
    let written = fs::File::create(&beside).and_then(|mut file| {
        file.write_all(encode(calibration, machine).as_bytes())?;
        file.sync_all()?;
        fs::rename(&beside, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&beside);
    }
    written
}

/// What pairmask keeps for a user: `$XDG_CACHE_HOME/pairmask`, else `~/.cache/pairmask`. `None`
/// where neither is known.
pub fn user_cache_folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let base = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")))?;
    Some(base.join("pairmask"))
}

/// Where a machine's constants are kept in the [`user_cache_folder`].
pub fn default_path(machine: &MachineKey) -> Option<PathBuf> {
    Some(user_cache_folder()?.join(machine.file_name()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written() -> (Calibration, String) {
        let mut calibration = Calibration::built_in(Isa::Portable);
        calibration.ns[3] = 0.1 + 0.2;
        calibration.ns[Term::from_name("grid-box").expect("a term").index()] = 112.0;
        calibration.threads[1] = ThreadCost { serial_share: 1.0 / 3.0, fan_out_ns: 0.0 };
        let text = encode(&calibration, &MachineKey::this());
        (calibration, text)
    }

    #[test]
    fn a_file_holds_every_bit_and_is_replaced_whole() {
        let folder = std::env::temp_dir().join(format!("pairmask-file-{}", std::process::id()));
        let (path, machine) = (folder.join("deep").join("calibration.toml"), MachineKey::this());
        let (calibration, _) = written();
        for _ in 0..2 {
            store(&path, &calibration, &machine).expect("writes");
            assert_eq!(load(&path, &machine).expect("reads"), calibration);
        }
        assert_eq!(fs::read_dir(path.parent().expect("has one")).expect("reads").count(), 1);
        fs::write(&path, vec![b'#'; 1 << 20]).expect("writes");
        assert!(matches!(load(&path, &machine), Err(CalibrationError::TooLong)));
        fs::remove_dir_all(&folder).expect("removes");
        assert!(matches!(load(&path, &machine), Err(CalibrationError::Read(_))));
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let (_, text) = written();
        let edited = |from: &str, to: &str| {
            assert!(text.contains(from), "{text}");
            decode(&text.replacen(from, to, 1), &MachineKey::this()).expect_err(to).to_string()
        };
        assert!(edited("version = 2", "version = 1").contains("version 1"));
        assert!(edited("release = \"", "release = \"9").contains("pairmaskd calibrate"));
        assert!(edited("machine = \"", "machine = \"other ").contains("another machine (other "));
        assert!(edited("sap-box = ", "sap-crate = ").contains("sap-box"));
        for wrong in ["-1.0", "nan", "inf", "1e9"] {
            let error = edited("grid-box = 112.0", &format!("grid-box = {wrong}"));
            assert!(error.contains("grid-box"), "{error}");
        }
        assert!(edited("serial-share = 0.1", "serial-share = 1.1").contains("serial-share"));
        assert!(edited("[ns]", "colour = 3\n[ns]").contains("colour"));
        assert!(decode("", &MachineKey::this()).is_err());
    }

    proptest! {
        #[test]
        fn no_text_is_a_panic(text in "\\PC*") {
            let _ = decode(&text, &MachineKey::this());
        }

        /// A flipped, lost or doubled piece gives an error or constants within their ranges.
        #[test]
        fn damage_is_an_error_or_harmless(at in 0usize..2000, cut in 0usize..40, put in "[ -~\n]{0,8}") {
            let (_, mut text) = written();
            let at = at.min(text.len());
            text.replace_range(at..(at + cut).min(text.len()), &put);
            if let Ok(found) = decode(&text, &MachineKey::this()) {
                prop_assert!(found.ns.iter().all(|ns| (0.0..=MOST_NS).contains(ns)));
                prop_assert!(found.threads.iter().all(|t| (0.0..=1.0).contains(&t.serial_share)));
            }
        }
    }
}
