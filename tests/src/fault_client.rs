//! A client process that fails on purpose: the program `fault_client`.

use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStdout, Command, Stdio};

use crate::daemon::TestDaemon;

/// A client that fails on purpose; killed when dropped.
#[derive(Debug)]
pub struct FaultClient {
    process: Child,
    said: Lines<BufReader<ChildStdout>>,
}

impl FaultClient {
    /// Starts `binary MODE ENGINE ..` and waits until it has had one frame answered.
    pub fn start(binary: &str, daemon: &TestDaemon, arguments: &[&str]) -> Self {
        let mut process = Command::new(binary)
            .args(arguments)
            .env("PAIRMASK_RUNTIME_DIR", daemon.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let said = BufReader::new(process.stdout.take().expect("piped")).lines();
        let mut client = Self { process, said };
        assert_eq!(client.next_line(), "connected");
        client
    }

    /// Lets it cause its fault.
    pub fn go(&mut self) {
        self.process.stdin.as_mut().expect("once").write_all(b"go\n").expect("it reads");
        assert_eq!(self.next_line(), "ready");
    }

    /// Whether it has ended by itself.
    pub fn has_ended(&mut self) -> bool {
        self.process.try_wait().expect("a child").is_some()
    }

    /// Ends its input, and returns what else it prints.
    pub fn end(mut self) -> Vec<String> {
        drop(self.process.stdin.take());
        self.said.by_ref().map_while(Result::ok).collect()
    }

    /// The next line that it prints.
    pub fn next_line(&mut self) -> String {
        self.said.next().expect("a line").expect("text")
    }
}

impl Drop for FaultClient {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
