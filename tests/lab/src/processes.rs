//! Client processes: each says lines of JSON, may be asked to begin, and ends when its stdin is closed.

use std::io::{self, BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pairmask::{Session, SessionBuilder};
use pairmask_core::engine::AvailableIsa;
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::{Signal, set_parent_process_death_signal};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::cli::load;
use crate::stress::clients;

#[derive(Serialize, Deserialize)]
pub(crate) enum Work {
    Load(load::ClientSettings),
    Stress(clients::ClientSettings),
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Daemon {
    pub(crate) dir: PathBuf,
    pub(crate) instance: String,
    pub(crate) isa: String,
}

impl Daemon {
    pub(crate) fn new(dir: &RuntimeDir, instance: &InstanceName, isa: AvailableIsa) -> Self {
        let (instance, isa) = (instance.to_string(), isa.to_string());
        Self { dir: dir.path().to_owned(), instance, isa }
    }

    pub(crate) fn session(&self) -> SessionBuilder {
        let isa = self.isa.parse().unwrap_or_else(|_| AvailableIsa::best());
        Session::builder().runtime_dir(RuntimeDir::at(&self.dir)).instance(&self.instance).isa(isa)
    }

    /// Starts a client process. `receive` gets each of its lines, and `None` after the last: half a line is the last one
    /// of a killed process.
    pub(crate) fn start<T: DeserializeOwned>(
        &self,
        work: &Work,
        mut receive: impl FnMut(Option<T>) + Send + 'static,
    ) -> io::Result<Worker> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["client", &serde_json::to_string(&(self, work))?]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (orders, said) = (child.stdin.take(), child.stdout.take());
        let worker = Worker { child, orders };
        let listen = move || {
            let lines = said.into_iter().flat_map(|said| BufReader::new(said).lines());
            let parsed = lines.map_while(|line| serde_json::from_str(&line.ok()?).ok());
            parsed.for_each(|said| receive(Some(said)));
            receive(None);
        };
        std::thread::Builder::new().name("listener".into()).spawn(listen)?;
        Ok(worker)
    }
}

pub(crate) fn work(job: &str) -> io::Result<()> {
    let (daemon, work): (Daemon, Work) = serde_json::from_str(job)?;
    // Nobody reads what it reports without a parent.
    set_parent_process_death_signal(Some(Signal::KILL))?;
    match work {
        Work::Load(settings) => settings.run(daemon.session()),
        Work::Stress(settings) => {
            let is_over = Arc::new(AtomicBool::new(false));
            let ends = Arc::clone(&is_over);
            std::thread::Builder::new().name("orders".into()).spawn(move || {
                // There are no orders but the end of them.
                let _ = io::copy(&mut io::stdin(), &mut io::sink());
                ends.store(true, Ordering::Relaxed);
            })?;
            settings.run(&daemon.session(), &is_over);
        }
    }
    Ok(())
}

#[derive(Debug)]
pub(crate) struct Worker {
    child: Child,
    orders: Option<ChildStdin>,
}

impl Worker {
    /// Asks the process to begin. One that has died is noticed by what it does not say.
    pub(crate) fn begin(&mut self) {
        if let Some(orders) = &mut self.orders {
            let _ = orders.write_all(b"begin\n");
        }
    }

    pub(crate) fn end(&mut self) {
        drop(self.orders.take());
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // One that has ended already needs neither.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Says a line to the process that started this child, which is there as long as this one is.
pub(crate) fn report(said: &impl Serialize) {
    let mut out = io::stdout().lock();
    let _ = writeln!(out, "{}", serde_json::to_string(said).unwrap_or_default());
    let _ = out.flush();
}

pub(crate) fn is_reported_to_begin() -> bool {
    io::stdin().lock().read_line(&mut String::new()).is_ok_and(|bytes| bytes > 0)
}
