//! Programs in C and C++, linked with the client library and run.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use pairmask_core::Aabb;
use pairmask_core::oracle::Pair;

/// How a program is built and run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Watch {
    /// With the sanitizers of the compiler for addresses and undefined behaviour.
    Sanitizers,
    /// By valgrind.
    Valgrind,
}

/// A program that was built.
#[derive(Debug)]
pub struct Program {
    binary: PathBuf,
    watch: Watch,
}

/// The folder of the C client.
fn client() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../client-lib/c")
}

/// Where the build has put the library: beside the program that runs this.
fn libraries() -> PathBuf {
    let here = std::env::current_exe().expect("the path of this program");
    here.parent().expect("a folder").to_owned()
}

impl Program {
    /// Builds `client-lib/c/tests/programs/SOURCE` into a folder, by a compiler's flags beside the warnings.
    ///
    /// # Panics
    /// When there is no compiler (`$CC`, `$CXX`), or it finds anything to warn of.
    pub fn build(source: &str, flags: &[&str], watch: Watch, folder: &Path) -> Self {
        let is_cpp = Path::new(source).extension().is_some_and(|extension| extension == "cpp");
        let (variable, usual) = if is_cpp { ("CXX", "c++") } else { ("CC", "cc") };
        let compiler = std::env::var(variable).unwrap_or_else(|_| usual.to_owned());
        let name = format!("{source}{}-{watch:?}", flags.concat().replace('/', "_"));
        let binary = folder.join(name);
        let libraries = libraries();
        let mut command = Command::new(&compiler);
        command
            .args(["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g", "-O1"])
            .args(flags)
            .arg("-I")
            .arg(client().join("include"))
            .arg(client().join("tests/programs").join(source))
            .arg("-o")
            .arg(&binary)
            .arg("-L")
            .arg(&libraries)
            .args(["-lpairmask_c", "-lm"])
            .arg(format!("-Wl,-rpath,{}", libraries.display()));
        if watch == Watch::Sanitizers {
            command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        }
        let status = command.status().unwrap_or_else(|error| panic!("{compiler}: {error}"));
        assert!(status.success(), "{command:?}");
        Self { binary, watch }
    }

    /// The program with its arguments, as it is watched.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = match self.watch {
            Watch::Sanitizers => Command::new(&self.binary),
            Watch::Valgrind => {
                let mut command = Command::new("valgrind");
                command
                    .args(["--quiet", "--error-exitcode=9", "--leak-check=full"])
                    .args(["--show-leak-kinds=definite,indirect"])
                    .args(["--errors-for-leak-kinds=definite,indirect"])
                    .arg(&self.binary);
                command
            }
        };
        command.args(arguments);
        command
    }

    /// Runs the program to its end, and returns what it printed.
    ///
    /// # Panics
    /// When it fails.
    pub fn run(&self, arguments: &[&str]) -> String {
        let mut command = self.command(arguments);
        let done = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let error = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{command:?}: {}\n{error}", done.status);
        String::from_utf8(done.stdout).expect("a text")
    }

    /// Starts a program that culls frames: `conformance.c` or `conformance.cpp`.
    ///
    /// # Panics
    /// When it does not start.
    pub fn cull(&self, arguments: &[&str]) -> Culling {
        let mut command = self.command(arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let frames = child.stdin.take().expect("piped");
        let answers = child.stdout.take().expect("piped");
        Culling { child, frames: Some(frames), answers }
    }
}

/// A program that culls frames. It is ended and must have succeeded when this is dropped.
#[derive(Debug)]
pub struct Culling {
    child: Child,
    frames: Option<ChildStdin>,
    answers: ChildStdout,
}

/// What such a program answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Culled {
    /// The pairs, sorted.
    pub pairs: Vec<Pair>,
    /// Boxes that are empty.
    pub empty: u32,
    /// Boxes that are invalid.
    pub invalid: u32,
    /// `PM_SERVED_BY_...`.
    pub served_by: u32,
}

impl Culling {
    /// Culls a frame.
    ///
    /// # Panics
    /// When the program has ended.
    pub fn frame(&mut self, boxes: &[Aabb]) -> Culled {
        let frames = self.frames.as_mut().expect("not ended");
        let n = u32::try_from(boxes.len()).expect("indices are u32");
        frames.write_all(&n.to_le_bytes()).expect("the program reads");
        frames.write_all(bytemuck::cast_slice(boxes)).expect("the program reads");
        frames.flush().expect("the program reads");
        let mut head = [0u32; 4];
        self.answers.read_exact(bytemuck::cast_slice_mut(&mut head)).expect("an answer");
        let [count, empty, invalid, served_by] = head;
        let mut found = vec![[0u32; 2]; count as usize];
        self.answers.read_exact(bytemuck::cast_slice_mut(&mut found)).expect("the pairs");
        let mut pairs: Vec<Pair> = found.into_iter().map(|[a, b]| (a, b)).collect();
        pairs.sort_unstable();
        Culled { pairs, empty, invalid, served_by }
    }

    /// Ends the program.
    ///
    /// # Panics
    /// When it fails, or its watch has found something.
    pub fn end(mut self) {
        drop(self.frames.take());
        let status = self.child.wait().expect("the program ends");
        assert!(status.success(), "{status}");
    }
}

impl Drop for Culling {
    fn drop(&mut self) {
        drop(self.frames.take());
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
