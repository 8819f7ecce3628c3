//! What C and C++ add to a frame of Rust: 1,000 boxes in process on one thread, each side a
//! process of its own, in turns.
//!
//! ```text
//! cmake -S client-lib/c -B build/pairmask && cmake --build build/pairmask
//! cargo bench -p pairmask-c --bench overhead
//! ```

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use pairmask::{Aabb, Backend, Session};

/// Frames of a turn: some 20 ms.
const FRAMES: u32 = 200;
/// Turns of each side: the ratio's median is known to half a percent on a machine that does other things too.
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

/// A program that culls frames when it is told to.
struct Program {
    child: Child,
    reported: ChildStdin,
    says: BufReader<ChildStdout>,
}

impl Program {
    /// Builds `benches/SOURCE` and starts it.
    fn start(compiler: &str, standard: &str, source: &str, folder: &Path, boxes: &Path) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        // As users build it: with link-time optimisation, as this program has it.
        let libraries = root.join("../../build/pairmask/lib");
        let binary = folder.join(source.replace('.', "-"));
        let mut build = Command::new(compiler);
        build.args([standard, "-O2"]).arg("-I").arg(root.join("include"));
        build.arg(root.join("benches").join(source)).arg("-o").arg(&binary);
        build.arg("-L").arg(&libraries).arg("-lpairmask");
        build.arg(format!("-Wl,-rpath,{}", libraries.display()));
        assert!(build.status().expect("a compiler").success(), "{build:?}");
        let mut command = Command::new(&binary);
        command.arg(boxes).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("the program runs");
        let reported = child.stdin.take().expect("piped");
        let says = BufReader::new(child.stdout.take().expect("piped"));
        Self { child, reported, says }
    }

    /// Nanoseconds of a frame, and what the pairs add up to.
    fn turn(&mut self) -> (f64, u64) {
        writeln!(self.reported, "{FRAMES}").expect("the program reads");
        let mut line = String::new();
        self.says.read_line(&mut line).expect("the program answers");
        let (ns, sum) = line.trim().split_once(' ').expect("two numbers");
        (ns.parse().expect("a number"), sum.parse().expect("a number"))
    }

    fn end(mut self) {
        drop(self.reported);
        assert!(self.child.wait().expect("the program ends").success());
    }
}

fn rust_turn(session: &mut Session, given: &[Aabb]) -> (f64, u64) {
    let start = Instant::now();
    let mut sum = 0;
    for _ in 0..FRAMES {
        let mut frame = session.frame(given.len()).expect("memory");
        frame.boxes_mut().copy_from_slice(given);
        let mask = frame.submit().expect("sent").wait().expect("answered");
        mask.for_each_slice(|pairs| {
            for [a, b] in pairs {
                sum += u64::from(a ^ b);
            }
        });
    }
    (start.elapsed().as_nanos() as f64 / f64::from(FRAMES), sum / u64::from(FRAMES))
}

/// The median, and the quartiles.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| values[values.len() * quarter / 4])
}

fn main() {
    let given = boxes();
    let folder = std::env::temp_dir().join(format!("pairmask-overhead-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let file = folder.join("boxes.f32");
    std::fs::write(&file, bytemuck::cast_slice(&given)).expect("written");
    let mut c = Program::start("cc", "-std=gnu11", "frames.c", &folder, &file);
    let mut cpp = Program::start("c++", "-std=c++17", "frames.cpp", &folder, &file);
    let builder = Session::builder().backend(Backend::InProcess).answer_repeats(false).threads(1);
    let mut session = builder.connect().expect("a session");

    let mut times = [(); 3].map(|()| Vec::new());
    let mut ratios = [(); 2].map(|()| Vec::new());
    for turn in 0..TURNS {
        // Each side is first as often as the others.
        let mut turns = [(0.0, 0); 3];
        for side in (0..3).map(|side| (side + turn) % 3) {
            turns[side] = match side {
                0 => rust_turn(&mut session, &given),
                1 => c.turn(),
                _ => cpp.turn(),
            };
        }
        assert!(turns.iter().all(|(_, sum)| *sum == turns[0].1), "the pairs differ: {turns:?}");
        for (all, (ns, _)) in times.iter_mut().zip(turns) {
            all.push(ns);
        }
        for (all, (ns, _)) in ratios.iter_mut().zip(&turns[1..]) {
            all.push(ns / turns[0].0);
        }
    }
    c.end();
    cpp.end();
    std::fs::remove_dir_all(&folder).expect("removed");

    println!(
        "1,000 boxes in process on one thread, µs a frame: median (quartiles), and the median ratio to Rust's turn"
    );
    for (side, (name, values)) in ["Rust", "C", "C++"].into_iter().zip(times).enumerate() {
        let [low, mid, high] = spread(values).map(|ns| ns / 1e3);
        let ratio = side.checked_sub(1).map_or(1.0, |at| spread(ratios[at].clone())[1]);
        println!("{name:<5} {mid:7.2} ({low:.2} to {high:.2})  {ratio:.4}");
    }
}
