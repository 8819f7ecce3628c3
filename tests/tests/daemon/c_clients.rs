//! Clients in C and C++: the suite's scenes and the golden ones, every call and every error, with sanitizers and
//! by valgrind, in process and through a daemon that may be killed.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

// The libraries of this crate are what the programs are linked with.
use pairmask_c as _;
use pairmask_tests::golden;
use pairmask_tests::oracle::pair_set_hash;
use pairmask_tests::prelude::*;

const C: &[&str] = &["-std=c11"];
const CPP: &[&str] = &["-std=c++17"];
const BY_DAEMON: u32 = 1;
const IN_PROCESS: u32 = 2;

/// Sizes of the suite that a program answers under a watch within seconds.
const SIZES: [u32; 10] = [0, 1, 2, 3, 31, 32, 33, 64, 70, 345];

#[derive(Clone, Copy, PartialEq)]
enum Watch {
    Sanitizers,
    Valgrind,
}

struct Program {
    folder: tempfile::TempDir,
    watch: Watch,
}

impl Program {
    /// Builds `client-lib/c/tests/programs/SOURCE` by a compiler's flags beside the warnings.
    fn build(source: &str, flags: &[&str], watch: Watch) -> Self {
        let is_cpp = Path::new(source).extension().is_some_and(|extension| extension == "cpp");
        let (variable, usual) = if is_cpp { ("CXX", "c++") } else { ("CC", "cc") };
        let compiler = std::env::var(variable).unwrap_or_else(|_| usual.to_owned());
        let folder = tempfile::tempdir().expect("a temporary directory");
        let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client-lib/c");
        // Where the build has put the library: beside the program that runs this.
        let here = std::env::current_exe().expect("the path of this program");
        let libraries = here.parent().expect("a folder");
        let mut command = Command::new(&compiler);
        command
            .args(["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g", "-O1"])
            .args(flags)
            .arg("-I")
            .arg(client.join("include"))
            .arg(client.join("tests/programs").join(source))
            .arg("-o")
            .arg(folder.path().join("program"))
            .arg("-L")
            .arg(libraries)
            .args(["-lpairmask_c", "-lm"])
            .arg(format!("-Wl,-rpath,{}", libraries.display()));
        if watch == Watch::Sanitizers {
            command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        }
        let status = command.status().unwrap_or_else(|error| panic!("{compiler}: {error}"));
        assert!(status.success(), "{command:?}");
        Self { folder, watch }
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let binary = self.folder.path().join("program");
        let mut command = match self.watch {
            Watch::Sanitizers => Command::new(&binary),
            Watch::Valgrind => {
                let mut command = Command::new("valgrind");
                command
                    .args(["--quiet", "--error-exitcode=9", "--leak-check=full"])
                    .args(["--show-leak-kinds=definite,indirect"])
                    .args(["--errors-for-leak-kinds=definite,indirect"])
                    .arg(&binary);
                command
            }
        };
        // Cargo's own path would prefer the library of an earlier build as a package to the one that was linked.
        command.args(arguments).env_remove("LD_LIBRARY_PATH");
        command
    }

    fn run(&self, arguments: &[&str]) -> String {
        let mut command = self.command(arguments);
        let done = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let error = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{command:?}: {}\n{error}", done.status);
        String::from_utf8(done.stdout).expect("a text")
    }

    /// Starts a program that culls frames: `conformance.c` or `conformance.cpp`.
    fn cull(&self, arguments: &[&str]) -> Culling {
        let mut command = self.command(arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let frames = child.stdin.take().expect("piped");
        let answers = child.stdout.take().expect("piped");
        Culling { child, frames: Some(frames), answers }
    }
}

struct Culling {
    child: Child,
    frames: Option<ChildStdin>,
    answers: ChildStdout,
}

struct Culled {
    pairs: Vec<Pair>,
    empty: u32,
    invalid: u32,
    /// `PM_SERVED_BY_...`.
    served_by: u32,
}

impl Culling {
    fn frame(&mut self, boxes: &[Aabb]) -> Culled {
        let frames = self.frames.as_mut().expect("not ended");
        let n = u32::try_from(boxes.len()).expect("indices are u32");
        // None is timed.
        frames.write_all(bytemuck::bytes_of(&[n, 0])).expect("the program reads");
        frames.write_all(bytemuck::cast_slice(boxes)).expect("the program reads");
        frames.flush().expect("the program reads");
        let mut head = [0u64; 5];
        self.answers.read_exact(bytemuck::cast_slice_mut(&mut head)).expect("an answer");
        let [count, empty, invalid, served_by, _] = head;
        let [empty, invalid, served_by] = [empty, invalid, served_by].map(|number| number as u32);
        let mut pairs: Vec<Pair> = vec![[0; 2]; count as usize];
        self.answers.read_exact(bytemuck::cast_slice_mut(&mut pairs)).expect("the pairs");
        pairs.sort_unstable();
        Culled { pairs, empty, invalid, served_by }
    }

    fn end(mut self) {
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

fn check_suite(program: &mut Culling, sizes: &[u32], served_by: u32) {
    for scene in stress_scenes::ALL {
        for &n in sizes {
            let boxes = scene.boxes(n, 1);
            let truth = oracle::truth(&boxes);
            let found = program.frame(&boxes);
            assert_eq!(found.pairs, truth.pairs, "{}, {n} boxes", scene.name());
            let census = (truth.census.empty, truth.census.invalid);
            assert_eq!((found.empty, found.invalid), census, "{}, {n} boxes", scene.name());
            assert_eq!(found.served_by, served_by);
        }
    }
}

fn check_golden(program: &mut Culling) {
    for (name, scene, golden) in golden::scenes() {
        let found = pair_set_hash(&program.frame(scene.boxes()).pairs);
        assert_eq!(found, golden, "{name}: {found:#018x}");
    }
}

fn conforms(source: &str, flags: &[&str]) {
    let program = Program::build(source, flags, Watch::Sanitizers);
    let daemon = TestDaemon::of_cores();
    let dir = daemon.path().to_str().expect("a path in UTF-8");
    for (backend, served_by) in [("in-process", IN_PROCESS), ("daemon", BY_DAEMON)] {
        for encoding in Encoding::ALL.map(Encoding::as_str).into_iter().chain(["auto"]) {
            let mut culling = program.cull(&[backend, dir, encoding]);
            check_suite(&mut culling, &SIZES, served_by);
            check_golden(&mut culling);
            culling.end();
        }
    }
}

#[test]
fn a_program_in_c_finds_the_pairs_of_the_suite() {
    conforms("conformance.c", C);
}

#[test]
fn a_program_in_cpp_finds_the_pairs_of_the_suite() {
    conforms("conformance.cpp", CPP);
}

#[test]
#[ignore = "slow: the nightly tier runs it"]
fn valgrind_finds_nothing_in_frames() {
    for (source, flags) in [("conformance.c", C), ("conformance.cpp", CPP)] {
        let program = Program::build(source, flags, Watch::Valgrind);
        let mut culling = program.cull(&["in-process", "/", "auto"]);
        check_suite(&mut culling, &[0, 3, 33, 345], IN_PROCESS);
        culling.end();
    }
}

#[test]
fn a_forked_child_leaves_its_parents_answers_alone() {
    let daemon = TestDaemon::of_cores();
    let dir = daemon.path().to_str().expect("a path in UTF-8");
    let program = Program::build("fork.c", C, Watch::Sanitizers);
    assert_eq!(program.run(&["daemon", dir, "auto"]), "parents and children\n");
}

fn every_call_and_every_error(watch: Watch, backends: &[&str]) {
    let daemon = TestDaemon::of_cores();
    let dir = daemon.path().to_str().expect("a path in UTF-8");
    let standards: [(&str, &[&str]); 4] = [
        ("calls.c", C),
        ("calls.cpp", CPP),
        ("calls.cpp", &["-std=c++17", "-fno-exceptions"]),
        ("calls.cpp", &["-std=c++20"]),
    ];
    for (source, flags) in standards {
        let program = Program::build(source, flags, watch);
        for backend in backends {
            for encoding in ["auto", "sparse"] {
                assert_eq!(program.run(&[backend, dir, encoding]), "all calls\n");
            }
        }
    }
}

#[test]
fn sanitizers_find_nothing_in_every_call_and_every_error() {
    every_call_and_every_error(Watch::Sanitizers, &["in-process", "daemon"]);
}

#[test]
#[ignore = "slow: the nightly tier runs it"]
fn valgrind_finds_nothing_in_every_call_and_every_error() {
    // valgrind up to 3.19 does not know pidfd_open, by which a client watches its daemon.
    every_call_and_every_error(Watch::Valgrind, &["in-process"]);
}

#[test]
fn a_daemon_that_is_killed_costs_no_frame() {
    let program = Program::build("conformance.c", C, Watch::Sanitizers);
    let mut daemon = TestDaemon::of_cores();
    let dir = daemon.path().to_str().expect("a path in UTF-8").to_owned();
    let mut culling = program.cull(&["auto", &dir, "auto"]);
    let mut frames = 0;
    // Culls frames, one or as many as it takes until they are answered by who should.
    let mut frame = |served_by: Option<u32>| {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let scene = stress_scenes::ALL[frames % stress_scenes::ALL.len()];
            let boxes = scene.boxes(200, frames as u64);
            frames += 1;
            let found = culling.frame(&boxes);
            assert_eq!(found.pairs, oracle::truth(&boxes).pairs, "frame {frames}");
            match served_by {
                Some(requested) if requested != found.served_by => {
                    assert!(Instant::now() < deadline);
                }
                _ => return,
            }
        }
    };
    for _ in 0..3 {
        (0..20).for_each(|_| frame(None));
        frame(Some(BY_DAEMON));
        daemon.kill();
        (0..20).for_each(|_| frame(None));
        frame(Some(IN_PROCESS));
        daemon.restart();
        frame(Some(BY_DAEMON));
    }
    culling.end();
}

#[test]
#[should_panic(expected = "assertion")]
fn a_lost_pair_is_seen() {
    let program = Program::build("conformance.c", C, Watch::Sanitizers);
    let mut culling = program.cull(&["in-process", "/", "auto"]);
    let boxes = stress_scenes::named("uniform").boxes(300, 2);
    let mut truth = oracle::truth(&boxes).pairs;
    assert!(truth.pop().is_some());
    assert_eq!(culling.frame(&boxes).pairs, truth, "assertion");
}
