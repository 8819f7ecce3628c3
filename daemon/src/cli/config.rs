//! The configuration file: the lowest layer of settings above the defaults.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use pairmask::plan::CalibrationChoice;
use pairmask::transport::InstanceName;
use pairmask::{Backend, EncodingChoice, EngineChoice};
use serde::{Deserialize, Deserializer};

use crate::audit::AuditRate;
use crate::execute::gpu::GpuChoice;

/// Settings of a configuration file. Keys are the flags' names.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
pub struct Config {
    #[serde(deserialize_with = "parsed")]
    pub instance: Option<InstanceName>,
    pub runtime_dir: Option<PathBuf>,
    #[serde(deserialize_with = "parsed")]
    pub backend: Option<Backend>,
    #[serde(deserialize_with = "parsed")]
    pub engine: Option<EngineChoice>,
    #[serde(deserialize_with = "parsed")]
    pub encoding: Option<EncodingChoice>,
    pub threads: Option<std::num::NonZeroUsize>,
    pub spin_us: Option<u64>,
    pub max_clients: Option<std::num::NonZeroU16>,
    pub max_reply_mib: Option<std::num::NonZeroU32>,
    #[serde(deserialize_with = "parsed")]
    pub gpu: Option<GpuChoice>,
    pub gpu_awake_ms: Option<u32>,
    #[serde(deserialize_with = "parsed")]
    pub calibration: Option<CalibrationChoice>,
    #[serde(deserialize_with = "parsed")]
    pub audit: Option<AuditRate>,
}

/// Why there is no configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file was named and cannot be read.
    #[error("configuration {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// It is not TOML, or holds a key or value that means nothing.
    #[error("configuration {}: {}", path.display(), one_line(source))]
    Parse { path: PathBuf, source: Box<toml::de::Error> },
}

/// The error without the excerpt that would spread it over several lines.
fn one_line(error: &toml::de::Error) -> String {
    error.message().replace('\n', " ")
}

/// A value that has a name, read as the command line reads it.
fn parsed<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err: std::fmt::Display>,
{
    let text = String::deserialize(deserializer)?;
    text.parse().map(Some).map_err(serde::de::Error::custom)
}

impl Config {
    /// Reads the file that was named, else the user's own where there is one.
    pub fn load(named: Option<&Path>) -> Result<Self, ConfigError> {
        let Some(path) = named.map(Path::to_owned).or_else(default_path) else {
            return Ok(Self::default());
        };
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if named.is_none() && error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self::default());
            }
            Err(source) => return Err(ConfigError::Read { path, source }),
        };
        toml::from_str(&text)
            .map_err(|source| ConfigError::Parse { path, source: Box::new(source) })
    }
}

/// `$XDG_CONFIG_HOME/pairmask/config.toml`, else `~/.config/pairmask/config.toml`.
fn default_path() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let home = set("XDG_CONFIG_HOME").or_else(|| Some(set("HOME")?.join(".config")))?;
    Some(home.join("pairmask").join("config.toml"))
}

#[cfg(test)]
mod tests {
    use pairmask::Encoding;

    use super::*;

    #[test]
    fn keys_are_the_names_of_the_flags() {
        let config: Config = toml::from_str(
            "instance = 'world'\nbackend = 'in-process'\nencoding = 'sparse'\n\
             threads = 2\nspin-us = 0\nmax-clients = 3\nmax-reply-mib = 64\nruntime-dir = '/run/x'\n\
             gpu = 'none'\ngpu-awake-ms = 0\ncalibration = 'built-in'",
        )
        .expect("every key is known");
        assert_eq!(config.instance.as_ref().map(InstanceName::as_str), Some("world"));
        assert_eq!(config.backend, Some(Backend::InProcess));
        assert_eq!(config.encoding, Some(EncodingChoice::Only(Encoding::Sparse)));
        assert_eq!(config.spin_us, Some(0));
        assert_eq!(config.gpu_awake_ms, Some(0));
        assert_eq!(config.calibration, Some(CalibrationChoice::BuiltIn));
        assert_eq!(config.engine, None);
    }

    #[test]
    fn unknown_keys_and_values_are_named() {
        for (text, named) in [
            ("motor = 'auto'", "motor"),
            ("engine = 'fast'", "fast"),
            ("threads = 0", "nonzero"),
            ("instance = 'A B'", "A B"),
        ] {
            let error = toml::from_str::<Config>(text).expect_err(text);
            assert!(one_line(&error).contains(named), "{error}");
        }
    }
}
