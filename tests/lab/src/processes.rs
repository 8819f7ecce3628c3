//! Child processes that work at the same time: each says lines of JSON, may be told to begin, and ends when its
//! stdin is closed.

use std::io::{self, BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, Command, Stdio};

use rustix::process::{Signal, set_parent_process_death_signal};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A running child; killed when dropped.
#[derive(Debug)]
pub(crate) struct Worker {
    child: Child,
    orders: Option<ChildStdin>,
}

impl Worker {
    /// Starts a process. `hear` gets each of its lines, and `None` after the last: half a line is the last one of
    /// a killed process.
    pub(crate) fn start<T: DeserializeOwned>(
        mut command: Command,
        mut hear: impl FnMut(Option<T>) + Send + 'static,
    ) -> io::Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (orders, said) = (child.stdin.take(), child.stdout.take());
        let worker = Self { child, orders };
        let listen = move || {
            let lines = said.into_iter().flat_map(|said| BufReader::new(said).lines());
            let parsed = lines.map_while(|line| serde_json::from_str(&line.ok()?).ok());
            parsed.for_each(|said| hear(Some(said)));
            hear(None);
        };
        std::thread::Builder::new().name("listener".into()).spawn(listen)?;
        Ok(worker)
    }

    /// Tells the process to begin. One that has died is noticed by what it does not say.
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

/// Lets this child end with the process that started it: there is nobody to tell then.
pub(crate) fn end_with_parent() -> io::Result<()> {
    Ok(set_parent_process_death_signal(Some(Signal::KILL))?)
}

/// Says a line to the process that started this child.
pub(crate) fn tell(said: &impl Serialize) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{}", serde_json::to_string(said)?)?;
    out.flush()
}

/// Waits until this child is told to begin; `false`: to end.
pub(crate) fn is_told_to_begin() -> io::Result<bool> {
    Ok(io::stdin().lock().read_line(&mut String::new())? > 0)
}
