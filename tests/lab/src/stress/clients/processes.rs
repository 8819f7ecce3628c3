//! The client processes of a run: started, killed, told to end.

use std::io::{self, BufRead, BufReader};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;

use super::protocol::{Ended, Said};

/// Which process said something: the clients have numbers from 0, and one that was killed lives again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Life {
    pub(super) client: usize,
    pub(super) life: u64,
}

/// What was heard of a process.
#[derive(Clone, Debug)]
pub(super) enum Heard {
    /// A line.
    Line(Said),
    /// It says nothing any more.
    End,
}

/// A running client; killed when dropped.
#[derive(Debug)]
pub(super) struct ClientProcess {
    /// Which.
    pub(super) life: Life,
    /// Its last words, once it has said them.
    pub(super) ended: Option<Ended>,
    child: Child,
    /// The client ends when this is closed.
    orders: Option<ChildStdin>,
}

impl ClientProcess {
    /// Starts a process. What it says goes to `heard`.
    ///
    /// # Errors
    /// Where the system starts no process or no thread.
    pub(super) fn start(
        mut command: Command,
        life: Life,
        heard: Sender<(Life, Heard)>,
    ) -> io::Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (orders, said) = (child.stdin.take(), child.stdout.take());
        let process = Self { life, ended: None, child, orders };
        if let Some(said) = said {
            let listen = move || listen(said, life, &heard);
            std::thread::Builder::new().name("listener".into()).spawn(listen)?;
        }
        Ok(process)
    }

    /// Tells the client to end.
    pub(super) fn end(&mut self) {
        drop(self.orders.take());
    }

    /// Kills the client wherever it is, with SIGKILL.
    ///
    /// # Errors
    /// Where the process is not to be had.
    pub(super) fn kill(mut self) -> io::Result<ExitStatus> {
        self.child.kill()?;
        self.child.wait()
    }
}

impl Drop for ClientProcess {
    fn drop(&mut self) {
        // One that has ended already needs neither.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Passes on what a client says, until it ends. A receiver that is gone needs no more.
fn listen(said: ChildStdout, life: Life, heard: &Sender<(Life, Heard)>) {
    for line in BufReader::new(said).lines().map_while(Result::ok) {
        // Half a line is the last one of a killed client.
        let Some(said) = Said::parse(&line) else { break };
        if heard.send((life, Heard::Line(said))).is_err() {
            return;
        }
    }
    let _ = heard.send((life, Heard::End));
}
