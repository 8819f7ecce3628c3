//! The daemon's own main, as a binary of this package: cargo builds it before the tests that
//! start it.

fn main() -> std::process::ExitCode {
    pairmaskd::cli::main()
}
