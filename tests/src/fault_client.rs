//! A client process that fails on purpose: the program `fault_client`.

use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStdout, Command, Stdio};

use crate::daemon::{TestDaemon, program};

#[derive(Debug)]
pub struct FaultClient {
    process: Child,
    said: Lines<BufReader<ChildStdout>>,
}

impl FaultClient {
    /// Starts `fault_client MODE ENGINE ..` and waits until it has had one frame answered.
    pub fn start(daemon: &TestDaemon, arguments: &[&str]) -> Self {
        Self::try_start(daemon, arguments).expect("it connects")
    }

    pub fn try_start(daemon: &TestDaemon, arguments: &[&str]) -> Option<Self> {
        let mut process = Command::new(program("fault_client"))
            .args(arguments)
            .env("PAIRMASK_RUNTIME_DIR", daemon.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let said = BufReader::new(process.stdout.take().expect("piped")).lines();
        let mut client = Self { process, said };
        (client.said.next()?.expect("text") == "connected").then_some(client)
    }

    pub fn go(&mut self) {
        assert!(self.is_ready(), "it ends before its fault");
    }

    pub fn is_ready(&mut self) -> bool {
        let reported = self.process.stdin.as_mut().expect("open").write_all(b"go\n");
        reported.is_ok() && self.said.next().is_some_and(|said| said.expect("text") == "ready")
    }

    pub fn has_ended(&mut self) -> bool {
        self.process.try_wait().expect("a child").is_some()
    }

    pub fn end(mut self) -> Vec<String> {
        drop(self.process.stdin.take());
        self.said.by_ref().map_while(Result::ok).collect()
    }

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
