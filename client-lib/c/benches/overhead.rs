//! What C, C++ and Python add to a frame of Rust: 1,000 boxes on one thread, each side a process, in turns.
//!
//! ```text
//! cmake -S client-lib/c -B build/pairmask && cmake --build build/pairmask
//! cargo bench -p pairmask-c --bench overhead                        C and C++, in process
//! cargo bench -p pairmask-c --bench overhead -- --python python3    Python too, where the package is installed
//! cargo bench -p pairmask-c --bench overhead -- --runtime-dir DIR   by the daemon that serves there
//! ```

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use pairmask::{Aabb, Backend, Session};

/// Frames of a turn: some 20 ms.
const FRAMES: u32 = 200;
/// Turns of each side: the ratio's median is known to half a percent on a machine that does other work too.
const TURNS: usize = 501;

/// The boxes of the issue's figure: 1,000 unit boxes in a cube of 14.
fn boxes() -> Vec<Aabb> {
    let mut state = 7u64;
    let mut next = || {
        // Knuth's MMIX generator.
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32 * 14.0
    };
    (0..1000).map(|_| [next(), next(), next()]).map(|p| Aabb::new(p, p.map(|x| x + 1.0))).collect()
}

/// Pairs, and the nanoseconds of a frame.
type Turn = (Vec<[u32; 2]>, f64);

/// A program that culls frames: `conformance.c`, which describes requests and answers, or its like.
struct Program {
    child: Child,
    requests: ChildStdin,
    answers: ChildStdout,
}

impl Program {
    fn start(command: &mut Command) -> Self {
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("the program runs");
        let requests = child.stdin.take().expect("piped");
        let answers = child.stdout.take().expect("piped");
        Self { child, requests, answers }
    }

    fn turn(&mut self, given: &[Aabb]) -> Turn {
        let head = [given.len() as u32, FRAMES];
        self.requests.write_all(bytemuck::bytes_of(&head)).expect("the program reads");
        self.requests.write_all(bytemuck::cast_slice(given)).expect("the program reads");
        let mut head = [0u64; 5];
        self.answers.read_exact(bytemuck::bytes_of_mut(&mut head)).expect("an answer");
        let mut pairs = vec![[0; 2]; head[0] as usize];
        self.answers.read_exact(bytemuck::cast_slice_mut(&mut pairs)).expect("the pairs");
        (pairs, head[4] as f64 / f64::from(FRAMES))
    }

    fn end(mut self) {
        drop(self.requests);
        assert!(self.child.wait().expect("the program ends").success());
    }
}

/// Builds `tests/programs/SOURCE`: as users do, with link-time optimisation, as this program has it.
fn compiled(
    compiler: &str,
    standard: &str,
    source: &str,
    folder: &Path,
    run: [&str; 4],
) -> Command {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let libraries = root.join("../../build/pairmask/lib");
    let binary = folder.join(source.replace('.', "-"));
    let mut build = Command::new(compiler);
    build.args([standard, "-O2"]).arg("-I").arg(root.join("include"));
    build.arg(root.join("tests/programs").join(source)).arg("-o").arg(&binary);
    build.arg("-L").arg(&libraries).arg("-lpairmask");
    build.arg(format!("-Wl,-rpath,{}", libraries.display()));
    assert!(build.status().expect("a compiler").success(), "{build:?}");
    let mut command = Command::new(binary);
    command.args(run);
    command
}

fn rust_turn(session: &mut Session, given: &[Aabb]) -> Turn {
    let mut pairs = Vec::new();
    let start = Instant::now();
    for _ in 0..FRAMES {
        let mut frame = session.frame(given.len()).expect("memory");
        frame.boxes_mut().copy_from_slice(given);
        let mask = frame.submit().expect("sent").wait().expect("answered");
        pairs.clear();
        mask.for_each_slice(|some| pairs.extend_from_slice(some));
    }
    (pairs, start.elapsed().as_nanos() as f64 / f64::from(FRAMES))
}

/// The median between the quartiles.
fn spread(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| values[values.len() * quarter / 4])
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let option = |name| arguments.get(arguments.iter().position(|given| given == name)? + 1);
    let (python, runtime_dir) = (option("--python"), option("--runtime-dir"));
    let given = boxes();
    let folder = std::env::temp_dir().join(format!("pairmask-overhead-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let builder = Session::builder().answer_repeats(false).threads(1);
    let (backend, builder) = match runtime_dir {
        Some(dir) => ("daemon", builder.backend(Backend::Daemon).runtime_dir(Path::new(dir))),
        None => ("in-process", builder.backend(Backend::InProcess)),
    };
    let dir = runtime_dir.map_or("-", String::as_str);
    let mut names = vec!["Rust", "C", "C++"];
    let run = [backend, dir, "auto", "timed"];
    let mut programs = vec![
        compiled("cc", "-std=c11", "conformance.c", &folder, run),
        compiled("c++", "-std=c++17", "conformance.cpp", &folder, run),
    ];
    for (name, way) in [("Python, session.cull", "cull"), ("Python, frame by frame", "frame")] {
        if let Some(python) = python {
            let mut command = Command::new(python);
            command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/frames.py"));
            command.args([backend, dir, way]);
            names.push(name);
            programs.push(command);
        }
    }
    let mut programs: Vec<Program> = programs.iter_mut().map(Program::start).collect();
    let mut session = builder.connect().expect("a session");

    let mut times = Vec::new();
    for turn in 0..TURNS {
        // Each side is first as often as the others.
        let mut turns = vec![Turn::default(); names.len()];
        for side in (0..names.len()).map(|side| (side + turn) % names.len()) {
            turns[side] = match side {
                0 => rust_turn(&mut session, &given),
                side => programs[side - 1].turn(&given),
            };
            turns[side].0.sort_unstable();
        }
        assert!(turns.iter().all(|(pairs, _)| *pairs == turns[0].0), "the pairs differ");
        times.push(turns.into_iter().map(|(_, ns)| ns / 1e3).collect::<Vec<f64>>());
    }
    programs.into_iter().for_each(Program::end);
    std::fs::remove_dir_all(&folder).expect("removed");

    println!("1,000 boxes, {backend}, one thread, µs a frame: median (quartiles), and medians of");
    println!("a turn's difference from Rust's turn and of its ratio to that");
    for (side, name) in names.iter().enumerate() {
        let [low, mid, high] = spread(times.iter().map(|turn| turn[side]));
        let [_, over, _] = spread(times.iter().map(|turn| turn[side] - turn[0]));
        let [_, ratio, _] = spread(times.iter().map(|turn| turn[side] / turn[0]));
        println!("{name:<22} {mid:7.2} ({low:.2} to {high:.2})  {over:+6.2}  {ratio:.4}");
    }
}
