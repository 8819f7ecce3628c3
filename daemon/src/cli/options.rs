//! Options that several commands share, and how flag, environment, file and default combine.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use pairmask::{Backend, Session, SessionBuilder};
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::{EncodingChoice, EngineChoice, EngineName};
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;

use super::config::Config;
use super::program::WrongUsage;
use super::whole_number::whole_number;
use crate::execute::gpu::{GpuChoice, GpuChoices};
use crate::serve::DaemonSettings;

/// Instance, runtime directory, configuration file and instruction set.
#[derive(Clone, Debug, Args)]
pub struct CommonOptions {
    /// Name of the instance [default: default]
    #[arg(long, global = true, env = "PAIRMASK_INSTANCE", value_name = "NAME")]
    instance: Option<InstanceName>,
    /// Directory that holds instances [default: `$XDG_RUNTIME_DIR/pairmask`, else `/tmp/pairmask-UID`]
    #[arg(long, global = true, env = "PAIRMASK_RUNTIME_DIR", value_name = "DIR")]
    runtime_dir: Option<PathBuf>,
    /// Configuration file [default: `$XDG_CONFIG_HOME/pairmask/config.toml`]
    #[arg(long, global = true, env = "PAIRMASK_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    /// Instruction set of engines and decoders: avx512, avx2, portable [default: the widest]
    #[arg(long, global = true, env = "PAIRMASK_ISA", value_name = "NAME")]
    isa: Option<AvailableIsa>,
    #[arg(skip)]
    pub(super) file: Config,
}

impl CommonOptions {
    pub fn named_instance(&self) -> Option<InstanceName> {
        self.instance.clone().or_else(|| self.file.instance.clone())
    }

    pub fn instance(&self) -> InstanceName {
        self.named_instance().unwrap_or_default()
    }

    pub fn runtime_dir(&self) -> RuntimeDir {
        let named = self.runtime_dir.as_ref().or(self.file.runtime_dir.as_ref());
        named
            .filter(|path| !path.as_os_str().is_empty())
            .map_or_else(RuntimeDir::from_env, RuntimeDir::at)
    }

    pub fn isa(&self) -> AvailableIsa {
        self.isa.or(self.file.isa).unwrap_or_else(AvailableIsa::best)
    }

    pub fn with_config_file(&self) -> Result<Self, WrongUsage> {
        let named = self.config.as_deref().filter(|path| !path.as_os_str().is_empty());
        Ok(Self { file: Config::load(named)?, ..self.clone() })
    }
}

/// Resources of a daemon or study that this command starts.
#[derive(Clone, Debug, Args)]
pub struct DaemonOptions {
    /// GPU of what is started: auto, none, software, a number or a name. A daemon takes several, with
    /// commas between them, or all [default: auto]
    #[arg(long, env = "PAIRMASK_GPU", value_name = "GPU")]
    gpu: Option<GpuChoices>,
}

impl DaemonOptions {
    pub fn gpus(&self, common: &CommonOptions) -> GpuChoices {
        self.gpu.clone().or_else(|| common.file.gpu.clone()).unwrap_or_default()
    }

    pub fn gpu(&self, common: &CommonOptions) -> GpuChoice {
        self.gpus(common).first()
    }

    pub fn private(&self, common: &CommonOptions) -> DaemonSettings {
        DaemonSettings { gpu: self.gpus(common), isa: common.isa(), ..DaemonSettings::default() }
    }
}

/// Backend, engine, encoding and threads of a frame.
#[derive(Clone, Debug, Args)]
pub struct CullFlags {
    /// Who finds the pairs: auto, daemon, in-process [default: auto]
    #[arg(long, env = "PAIRMASK_BACKEND", value_name = "NAME")]
    backend: Option<Backend>,
    #[arg(
        long,
        env = "PAIRMASK_ENGINE",
        value_name = "NAME",
        help = format!("auto, {} [default: auto]", EngineName::listed(" or ")),
    )]
    engine: Option<EngineChoice>,
    /// How the mask is written: auto, dense, sparse, list [default: auto]
    #[arg(long, env = "PAIRMASK_ENCODING", value_name = "NAME")]
    encoding: Option<EncodingChoice>,
    /// Threads that an engine may use [default: the plan's choice]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, env = "PAIRMASK_THREADS", value_name = "N")]
    threads: Option<NonZeroUsize>,
}

impl CullFlags {
    pub fn backend(&self, common: &CommonOptions, default: Backend) -> Backend {
        self.backend.or(common.file.backend).unwrap_or(default)
    }

    pub fn cull_options(&self, common: &CommonOptions) -> CullOptions {
        CullOptions {
            engine: self.engine(common),
            encoding: self.encoding.or(common.file.encoding).unwrap_or_default(),
            threads: self.threads.or(common.file.threads).map(NonZeroUsize::get),
            ..CullOptions::default()
        }
    }

    pub fn engine(&self, common: &CommonOptions) -> EngineChoice {
        self.engine.or(common.file.engine).unwrap_or_default()
    }

    /// A session builder with all settings but the backend. Its frames are culled also where they are equal
    /// to the last one: the commands that use it measure engines.
    pub fn session(&self, common: &CommonOptions) -> SessionBuilder {
        let cull_options = self.cull_options(common);
        let builder = Session::builder()
            .isa(common.isa())
            .engine(cull_options.engine)
            .encoding(cull_options.encoding)
            .answer_repeats(false);
        match cull_options.threads {
            Some(threads) => builder.threads(threads),
            None => builder,
        }
    }
}
