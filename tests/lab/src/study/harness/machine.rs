//! The machine and build of a study.

use pairmaskd::cli::machine;
use pairmaskd::execute::gpu::AdapterInfo;
use serde::Serialize;

use super::document::Part;

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Machine {
    pub cpu: String,
    pub threads: usize,
    pub gpu: Option<String>,
    pub driver: Option<String>,
    pub gpu_is_software: bool,
    pub rustc: String,
    pub optimised: bool,
    pub commit: String,
    pub command: String,
}

impl Machine {
    pub fn here(adapter: Option<&AdapterInfo>) -> Self {
        let this = machine::Machine::this();
        Self {
            cpu: this.cpu,
            threads: rayon::current_num_threads(),
            gpu: adapter.map(|a| a.name.clone()),
            driver: adapter.map(|a| a.driver.clone()),
            gpu_is_software: adapter.is_some_and(AdapterInfo::is_software),
            rustc: this.toolchain,
            optimised: !cfg!(debug_assertions),
            commit: this.commit,
            command: this.command,
        }
    }

    pub fn parts(&self) -> [Part; 2] {
        let Self { cpu, threads, gpu, driver, rustc, commit, command, .. } = self;
        let gpu = match (gpu, driver) {
            (Some(gpu), driver) => format!("; {gpu} ({})", driver.as_deref().unwrap_or("-")),
            (None, _) => String::new(),
        };
        let software = if self.gpu_is_software {
            " The GPU is software: its times are the CPU's."
        } else {
            ""
        };
        let debug = if self.optimised { "" } else { " **Not optimised: times mean nothing.**" };
        let build = format!("{rustc}; commit {commit}.{software}{debug}");
        [
            Part::text(format!("{cpu}, {threads} threads{gpu}; {build}")),
            Part::text(format!("`{command}`")),
        ]
    }
}
