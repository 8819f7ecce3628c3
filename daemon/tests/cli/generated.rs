//! Completions and manual pages: made of the commands and flags that help lists, and of no others.

use std::process::{Command, Stdio};

use crate::support::Sandbox;

/// Flags that a supervisor passes to its worker.
const HIDDEN: [&str; 3] = ["seccomp-log", "private-to", "restarted"];

#[test]
fn completions_name_what_help_lists() {
    let sandbox = Sandbox::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let finished = sandbox.run_line(&format!("completions {shell}"));
        assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{shell}");
        for name in ["serve", "latency", "max-clients", "runtime-dir", "completions"] {
            assert!(finished.stdout.contains(name), "{shell}: {name}");
        }
        for name in HIDDEN {
            assert!(!finished.stdout.contains(name), "{shell}: {name}");
        }
    }
    let finished = sandbox.run_line("completions dos");
    assert!(finished.error(2).contains("choose one of bash"), "{finished:?}");
}

/// As a shell asks: words, and the number of the one that is completed.
#[test]
fn bash_completes_commands_flags_and_their_flags() {
    let sandbox = Sandbox::new();
    let script = sandbox.file("completions");
    std::fs::write(&script, sandbox.run_line("completions bash").stdout).unwrap();
    let completed = |line: &str| {
        let count = line.split(' ').count() - 1;
        let ask = format!(
            "source {}; COMP_WORDS=({line}); COMP_CWORD={count}; \
             _pairmaskd pairmaskd \"${{COMP_WORDS[{count}]}}\" \"${{COMP_WORDS[{count}-1]}}\"; \
             echo \"${{COMPREPLY[@]}}\"",
            script.display()
        );
        let output = Command::new("bash").args(["-c", &ask]).stdin(Stdio::null()).output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim_end().to_owned()
    };
    assert_eq!(completed("pairmaskd ser"), "serve");
    assert_eq!(completed("pairmaskd serve --max-c"), "--max-clients");
    assert_eq!(completed("pairmaskd bench latency --wa"), "--warm-up --wait");
    assert_eq!(completed("pairmaskd scene --inst"), "", "which help does not list there");
    assert_eq!(completed("pairmaskd serve --inst"), "--instance");
}

#[test]
fn each_command_has_a_page() {
    let sandbox = Sandbox::new();
    let finished = sandbox.run_line("man --out pages/man1");
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let page = |name: &str| std::fs::read_to_string(sandbox.file("pages/man1").join(name)).unwrap();
    for (name, expected) in [
        ("pairmaskd.1", "pairmaskd\\-serve(1)"),
        ("pairmaskd-serve.1", "PAIRMASK_MAX_CLIENTS"),
        ("pairmaskd-bench-latency.1", "\\-\\-frames"),
        ("pairmaskd-man.1", "COMMAND"),
    ] {
        assert!(page(name).contains(expected), "{name}: {}", page(name));
    }
    let serve = page("pairmaskd-serve.1").replace('\\', "");
    assert!(HIDDEN.iter().all(|name| !serve.contains(name)), "{serve}");
    assert!(!page("pairmaskd-scene.1").contains("runtime"), "which it does not use");
    assert_eq!(sandbox.run_line("man serve").stdout, page("pairmaskd-serve.1"));
    assert_eq!(sandbox.run_line("man").stdout, page("pairmaskd.1"));
    for (line, code, expected) in [
        ("man sing", 2, "there is no command 'sing'"),
        ("man serve --out pages", 2, "exclude each other"),
        ("man --out /dev/null/pages", 1, "/dev/null/pages: it is no directory"),
    ] {
        let finished = sandbox.run_line(line);
        assert!(finished.error(code).contains(expected), "{finished:?}");
    }
}
