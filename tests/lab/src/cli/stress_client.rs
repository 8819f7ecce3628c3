//! `stress-client`: a client process of `stress --clients`.

use std::io::{self, Read};
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use pairmask::Session;
use pairmask_core::engine::AvailableIsa;
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::Place;
use pairmaskd::cli::output::OutputError;
use pairmaskd::cli::whole_number::whole_number;
use rustix::process::{Signal, set_parent_process_death_signal};

use crate::stress::clients::ClientSettings;
use crate::stress::{Entrant, ModeChoice};

/// A client process of `stress --clients`.
#[derive(Debug, Args)]
pub struct StressClient {
    #[arg(long, value_parser = whole_number::<u64>)]
    seed: u64,
    #[arg(long, value_parser = whole_number::<u64>)]
    case: Option<u64>,
    #[arg(long, value_delimiter = ',')]
    engine: Vec<Entrant>,
    #[arg(long, value_delimiter = ',')]
    mode: Vec<ModeChoice>,
    #[arg(long, value_parser = whole_number::<NonZeroUsize>)]
    threads: NonZeroUsize,
    /// The daemon has a GPU.
    #[arg(long)]
    with_gpu: bool,
    /// Sessions are closed with frames under way.
    #[arg(long)]
    abrupt: bool,
}

/// The command of a client with these settings.
pub fn client_command(
    binary: &Path,
    dir: &RuntimeDir,
    instance: &InstanceName,
    isa: AvailableIsa,
    settings: &ClientSettings,
) -> Command {
    let ClientSettings { seed, case, entrants, modes, threads, with_gpu, abrupt } = settings;
    let mut command = Command::new(binary);
    command
        .arg("stress-client")
        .args(["--instance", instance.as_str()])
        .arg("--runtime-dir")
        .arg(dir.path())
        .args(["--isa", &isa.to_string()])
        .args(["--seed", &seed.to_string()])
        .args(["--threads", &threads.to_string()]);
    for entrant in entrants {
        command.args(["--engine", &entrant.to_string()]);
    }
    for mode in modes {
        command.args(["--mode", &mode.to_string()]);
    }
    if let Some(case) = case {
        command.args(["--case", &case.to_string()]);
    }
    if *with_gpu {
        command.arg("--with-gpu");
    }
    if *abrupt {
        command.arg("--abrupt");
    }
    command
}

impl StressClient {
    /// Sends frames and checks answers until stdin ends.
    pub fn run(&self, place: &Place) -> Result<(), OutputError> {
        let config = Config::default();
        // Without its parent a client has nobody to tell.
        set_parent_process_death_signal(Some(Signal::KILL)).map_err(io::Error::from)?;
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&is_over);
        std::thread::Builder::new().name("orders".into()).spawn(move || {
            // There are no orders but the end of them.
            let _ = io::stdin().read_to_end(&mut Vec::new());
            ends.store(true, Ordering::Relaxed);
        })?;
        let settings = ClientSettings {
            seed: self.seed,
            case: self.case,
            entrants: self.engine.clone(),
            modes: self.mode.clone(),
            threads: self.threads.get(),
            with_gpu: self.with_gpu,
            abrupt: self.abrupt,
        };
        let daemon = Session::builder()
            .runtime_dir(place.runtime_dir(&config))
            .instance(place.instance(&config).as_str())
            .isa(place.isa(&config));
        Ok(settings.run(&daemon, &is_over, &mut io::stdout().lock())?)
    }
}
