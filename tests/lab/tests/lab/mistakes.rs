//! Mistakes of users: each is one line on stderr that says what to do.

use super::support::Sandbox;

#[test]
fn a_mistake_is_reported_in_one_line() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&pairmask_tests::stress_scenes::named("uniform").boxes(70, 1));
    for (line, code, expected) in [
        ("", 2, "a command is missing, one of stress, accuracy"),
        ("stress --case 1 --seed 2", 2, "--case and --seed exclude each other"),
        ("stress --kills", 2, "--clients"),
        ("stress --engine nobody", 2, "'nobody' for --engine: choose one of"),
        ("stress --mode q17", 2, "'q17' for --mode: choose one of"),
        ("stress --engine spheres --mode q16", 1, "nothing to run"),
        ("stress --engine scenes", 1, "nothing to run"),
        ("stress --engine gpu-brute --gpu none", 1, "GPU"),
        ("stress --clients 2 --engine scenes --mode q8", 1, "nothing to ask the daemon for"),
        ("stress --clients 2 --engine gpu-grid", 1, "nothing to ask the daemon for"),
        ("stress --clients 2 --instance nobody", 1, "no daemon serves instance 'nobody'"),
        ("load --rate 0", 2, "'0' for --rate: must be a whole number of Hz from 1 to 100000"),
        ("load --clients -1", 2, "must be a whole number of clients from 1 to 256"),
        ("load --mix 1000", 2, "must be boxes x clients, such as 1000x7"),
        ("load --mix 1x200,2x200", 2, "--mix has 400 clients: leave some out"),
        ("load --mix 1x2 --n 1", 2, "--mix and --n exclude each other"),
        ("load --seconds 0", 2, "must be at least 1"),
        ("soak --seconds 79", 2, "--seconds has to be 80 at least, for 8 samples"),
        ("soak --interval 0", 2, "must be at least 1"),
        ("soak --seconds 80 --instance nobody", 1, "no daemon serves instance 'nobody'"),
        ("grid --n x", 2, "'x' for --n: must be a whole number"),
        ("accuracy --out boxes.f32", 1, "boxes.f32: it is no directory"),
        ("accuracy --gpu 99 --n 10", 1, "no GPU fits '99'"),
        ("mapping --gpu none --quick --out boxes.f32", 1, "boxes.f32: it is no directory"),
        ("papers --only-records --from nowhere", 1, "nowhere"),
        ("papers --only-records --quick", 2, "--only-records and --quick exclude each other"),
        ("accuracy --precision f64=-1", 2, "is no mode"),
        ("stress --config absent", 2, "configuration absent: there is no such file"),
    ] {
        let finished = sandbox.run_line(line);
        assert!(finished.error(code).contains(expected), "{line}: {finished:?}");
        assert_eq!(finished.stdout, "", "{line}");
    }
}

#[test]
fn help_lists_what_works() {
    let sandbox = Sandbox::new();
    for (line, listed, absent) in [
        (
            "stress --help",
            &["--gpu", "--config", "--instance", "--clients"][..],
            &["\n  client"][..],
        ),
        ("grid --help", &["--gpu", "--config"], &["--instance", "--isa"]),
        ("accuracy --help", &["--runtime-dir", "[default: daemon]"], &[]),
        ("plan --help", &["--isa"], &["--instance"]),
        ("spheres --help", &["--gpu"], &["--isa", "--config"]),
        ("load --help", &["--instance", "[default: daemon]"], &[]),
        ("--help", &["stress", "accuracy", "load", "soak"], &["\n  serve", "\n  client"]),
    ] {
        let help = sandbox.run_line(line).stdout;
        assert!(listed.iter().all(|flag| help.contains(flag)), "{line}: {help}");
        assert!(!absent.iter().any(|flag| help.contains(flag)), "{line}: {help}");
    }
}

/// Mesa's layer complains of a missing display server on stderr. With `auto` the adapters are listed
/// and none is opened: quick, and with or without a GPU.
#[test]
fn driver_warnings_are_not_shown() {
    let sandbox = Sandbox::new();
    let line = "accuracy --scene uniform --n 10 --frames 1 --precision exact --backend in-process --gpu auto";
    let finished = sandbox.run_line(line);
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
}
