//! Every target over its whole corpus, and over inputs that are nearly those: cut short, and with a bit flipped.

use std::fs;
use std::panic;
use std::path::Path;

use pairmask_fuzz::{TARGETS, Target};

/// Cuts and flips of an input, spread over its length.
const CHANGES: usize = 16;

/// The inputs of a target, by their names.
fn corpus(name: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
    let entries =
        fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut inputs: Vec<(String, Vec<u8>)> = entries
        .map(|entry| {
            let path = entry.expect("a file").path();
            (path.display().to_string(), fs::read(&path).expect("an input"))
        })
        .collect();
    inputs.sort();
    inputs
}

fn run(target: Target, input: &[u8], what: &str) {
    let (name, decode) = target;
    if let Err(panic) = panic::catch_unwind(|| decode(input)) {
        eprintln!("{name}, {what}: {input:?}");
        panic::resume_unwind(panic);
    }
}

fn run_all(name: &str) {
    let target = *TARGETS.iter().find(|(target, _)| *target == name).expect("a target");
    let inputs = corpus(name);
    assert!(inputs.len() >= 3, "the corpus of {name} is lost");
    for (path, input) in &inputs {
        run(target, input, path);
        let step = input.len().div_ceil(CHANGES).max(1);
        for at in (0..input.len()).step_by(step) {
            run(target, &input[..at], &format!("{path} cut at {at}"));
            let mut flipped = input.clone();
            flipped[at] ^= 1 << (at / step % 8);
            run(target, &flipped, &format!("{path} flipped at {at}"));
        }
    }
}

/// One test a target, and one that there is one.
macro_rules! tests {
    ($($name:ident)+) => {
        $(
            #[test]
            fn $name() {
                run_all(stringify!($name));
            }
        )+

        #[test]
        fn every_target_has_a_corpus() {
            assert_eq!(TARGETS.map(|(name, _)| name), [$(stringify!($name)),+]);
        }
    };
}

tests!(culls edits files masks questions recordings replies requests);
