//! The client processes of a load: started together, awaited together, killed together.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use super::protocol::{START, Said, lost};
use crate::cli::bench::latency::BenchError;
use crate::cli::bench::measured::Figures;

/// A running client; killed when dropped, so that an error leaves none behind.
#[derive(Debug)]
struct Client {
    child: Child,
    said: BufReader<ChildStdout>,
    /// The client ends when this is closed.
    orders: Option<ChildStdin>,
}

/// All clients of a load.
#[derive(Debug)]
pub(super) struct Clients(Vec<Client>);

impl Clients {
    /// Starts a process for each command, and waits until every one is connected.
    ///
    /// # Errors
    /// [`BenchError`]; no client is left then.
    pub(super) fn start(commands: impl IntoIterator<Item = Command>) -> Result<Self, BenchError> {
        let started: Result<Vec<Client>, BenchError> =
            commands.into_iter().map(Client::start).collect();
        let mut clients = Self(started?);
        for client in &mut clients.0 {
            match client.hear()? {
                Said::Ready => {}
                Said::Done(_) => return Err(out_of_turn()),
                Said::Failed(why) => return Err(BenchError::Client { why }),
            }
        }
        Ok(clients)
    }

    /// Lets all clients begin.
    pub(super) fn begin(&mut self) {
        for client in &mut self.0 {
            // A client that has died is told of by its missing figures.
            if let Some(orders) = &mut client.orders {
                let _ = orders.write_all(START.as_bytes());
            }
        }
    }

    /// Waits until all are done. Their figures are in the order of their commands; they stay
    /// connected.
    pub(super) fn figures(&mut self) -> Result<Vec<Figures>, BenchError> {
        let told = self.0.iter_mut().map(|client| match client.hear()? {
            Said::Done(figures) => Ok(*figures),
            Said::Ready => Err(out_of_turn()),
            Said::Failed(why) => Err(BenchError::Client { why }),
        });
        told.collect()
    }

    /// Lets all clients end, and waits for them.
    pub(super) fn end(mut self) {
        for client in &mut self.0 {
            drop(client.orders.take());
        }
        for client in &mut self.0 {
            // It has told its figures: how it ends says nothing more.
            let _ = client.child.wait();
        }
    }
}

impl Client {
    fn start(mut command: Command) -> Result<Self, BenchError> {
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(lost)?;
        let orders = child.stdin.take();
        let Some(said) = child.stdout.take().map(BufReader::new) else {
            return Err(out_of_turn());
        };
        Ok(Self { child, said, orders })
    }

    /// The client's next line.
    fn hear(&mut self) -> Result<Said, BenchError> {
        let mut line = String::new();
        if self.said.read_line(&mut line).map_err(lost)? == 0 {
            let status = self.child.wait().map_err(lost)?;
            return Err(BenchError::Client { why: format!("it ended without a word ({status})") });
        }
        serde_json::from_str(&line).map_err(lost)
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        // One that has ended already needs neither.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn out_of_turn() -> BenchError {
    BenchError::Client { why: "it spoke out of turn: please report this".to_owned() }
}
