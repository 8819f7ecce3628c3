//! The configuration file: the lowest layer of settings above the defaults.

use std::io::ErrorKind;
use std::num::ParseIntError;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use pairmask::Backend;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::{EncodingChoice, EngineChoice};
use pairmask_wire::InstanceName;
use serde::{Deserialize, Deserializer};

use super::group::GroupId;
use super::memory_size::MemorySize;
use super::program::WrongUsage;
use super::whole_number::whole_number;
use crate::audit::AuditRate;
use crate::execute::gpu::GpuChoices;
use crate::file_error::{Access, FileError};
use crate::serve::fences::WithoutFences;
use crate::{path_in, user_folder};

/// Settings of a configuration file. Keys are the flags' names.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
pub struct Config {
    #[serde(deserialize_with = "parsed")]
    pub(super) instance: Option<InstanceName>,
    #[serde(deserialize_with = "parsed")]
    pub(super) runtime_dir: Option<PathBuf>,
    #[serde(deserialize_with = "parsed")]
    pub(super) backend: Option<Backend>,
    #[serde(deserialize_with = "parsed")]
    pub(super) engine: Option<EngineChoice>,
    #[serde(deserialize_with = "parsed")]
    pub(super) encoding: Option<EncodingChoice>,
    #[serde(deserialize_with = "number")]
    pub(super) threads: Option<std::num::NonZeroUsize>,
    #[serde(deserialize_with = "number")]
    pub(super) spin_us: Option<u64>,
    #[serde(deserialize_with = "number")]
    pub(super) max_clients: Option<std::num::NonZeroU16>,
    #[serde(deserialize_with = "number")]
    pub(super) max_reply_mib: Option<std::num::NonZeroU32>,
    #[serde(deserialize_with = "parsed")]
    pub(super) max_memory: Option<MemorySize>,
    #[serde(deserialize_with = "parsed")]
    pub(super) gpu: Option<GpuChoices>,
    #[serde(deserialize_with = "number")]
    pub(super) gpu_awake_ms: Option<u32>,
    #[serde(deserialize_with = "parsed")]
    pub(super) isa: Option<AvailableIsa>,
    #[serde(deserialize_with = "parsed")]
    pub(super) audit: Option<AuditRate>,
    #[serde(deserialize_with = "parsed")]
    pub(super) without_fence: Option<WithoutFences>,
    #[serde(deserialize_with = "number")]
    pub(super) probe_ms: Option<u32>,
    #[serde(deserialize_with = "parsed")]
    pub(super) allow_group: Option<GroupId>,
    #[serde(deserialize_with = "parsed")]
    pub(super) metrics_file: Option<PathBuf>,
}

const QUOTED_CHARS: usize = 60;

/// The place in `text` and the mistake, without the parser's excerpt of several lines.
fn one_line(text: &str, error: &toml::de::Error) -> String {
    let what = error.message().replace('\n', " ");
    // The parser's words for Rust types mean nothing to users.
    let what = what.replace("unknown field", "unknown key");
    let what = what.replace(", expected one of", ", the keys are");
    let start = error.span().map_or(0, |span| span.start.min(text.len()));
    let number = text.get(..start).unwrap_or_default().matches('\n').count();
    let line: String =
        text.lines().nth(number).unwrap_or_default().chars().take(QUOTED_CHARS).collect();
    format!("line {} ({}): {what}", number + 1, line.trim())
}

/// A named value, parsed as on the command line.
fn parsed<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err: std::fmt::Display>,
{
    match toml::Value::deserialize(deserializer)? {
        toml::Value::String(text) => text.parse().map(Some).map_err(serde::de::Error::custom),
        _ => Err(serde::de::Error::custom("must be text in quotes")),
    }
}

/// A whole number within the limits of the command line.
fn number<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err = ParseIntError>,
{
    match toml::Value::deserialize(deserializer)? {
        toml::Value::Integer(n) => {
            whole_number(&n.to_string()).map(Some).map_err(serde::de::Error::custom)
        }
        _ => Err(serde::de::Error::custom("must be a whole number without quotes")),
    }
}

impl Config {
    /// Reads the file that the user named, else the default file, whose absence is no error.
    pub fn load(named: Option<&Path>) -> Result<Self, WrongUsage> {
        let Some(path) = named.map(Path::to_owned).or_else(default_path) else {
            return Ok(Self::default());
        };
        let text = std::fs::read_to_string(&path);
        let kind = text.as_ref().err().map(std::io::Error::kind);
        if named.is_none() && kind == Some(ErrorKind::NotFound) {
            return Ok(Self::default());
        }
        let text = text.map_err(FileError::of(&path, Access::Read)).map_err(|error| {
            let of_file = match named {
                Some(_) => format!("configuration {error}"),
                None => format!(
                    "your configuration {error}; or name another by --config, /dev/null for none"
                ),
            };
            // Whether there is such a file is not known either, in a home that is closed to this user.
            let is_hidden = named.is_none()
                && kind == Some(ErrorKind::PermissionDenied)
                && std::fs::symlink_metadata(&path).is_err();
            WrongUsage(is_hidden.then(other_users_home).flatten().unwrap_or(of_file))
        })?;
        Self::parse(&text)
            .map_err(|what| WrongUsage(format!("configuration {}, {what}", path.display())))
    }

    /// Reads the text of a file. What is wrong with it is one line that names the place.
    pub fn parse(text: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|error| one_line(text, &error))
    }
}

/// `$XDG_CONFIG_HOME/pairmask/config.toml`, else `~/.config/pairmask/config.toml`.
fn default_path() -> Option<PathBuf> {
    Some(user_folder("XDG_CONFIG_HOME", ".config")?.join("config.toml"))
}

/// What to do about the variable behind the default file, where it names another user's directory.
fn other_users_home() -> Option<String> {
    let mut named = ["XDG_CONFIG_HOME", "HOME"].into_iter().filter_map(|v| Some((v, path_in(v)?)));
    let (variable, path) = named.next()?;
    let owner = std::fs::metadata(&path).ok()?.uid();
    let is_own = owner == rustix::process::geteuid().as_raw();
    let path = path.display();
    (!is_own).then(|| {
        format!(
            "{variable} is {path}, which belongs to user {owner} and not to you: set it to a directory of your own, or name a configuration by --config, /dev/null for none"
        )
    })
}

#[cfg(test)]
mod tests {
    use pairmask_core::Encoding;

    use super::*;

    #[test]
    fn keys_are_the_names_of_the_flags() {
        let config = Config::parse(
            "instance = 'world'\nbackend = 'in-process'\nencoding = 'sparse'\n\
             threads = 2\nspin-us = 0\nmax-clients = 3\nmax-reply-mib = 64\nmax-memory = '2G'\nruntime-dir = '/run/x'\n\
             gpu = 'none'\ngpu-awake-ms = 0\nisa = 'portable'\nwithout-fence = 'landlock,rlimits'\nprobe-ms = 0\nallow-group = '7'\n\
             metrics-file = '/run/x.prom'",
        )
        .expect("every key is known");
        assert_eq!(config.instance.as_ref().map(InstanceName::as_str), Some("world"));
        assert_eq!(config.backend, Some(Backend::InProcess));
        assert_eq!(config.encoding, Some(EncodingChoice::Only(Encoding::Sparse)));
        assert_eq!(config.spin_us, Some(0));
        assert_eq!(config.max_memory, Some(MemorySize(2 << 30)));
        assert_eq!(config.gpu_awake_ms, Some(0));
        assert_eq!(config.isa, AvailableIsa::new(pairmask_core::engine::Isa::Portable));
        assert_eq!(config.without_fence, Some("landlock,rlimits".parse().expect("two fences")));
        assert_eq!(config.probe_ms, Some(0));
        assert_eq!(config.allow_group, Some(GroupId(7)));
        assert_eq!(config.metrics_file, Some(PathBuf::from("/run/x.prom")));
        assert_eq!(config.engine, None);
    }
}
