//! The `pairmaskd` binary: the whole command line is in the library, where tests reach it.

fn main() -> std::process::ExitCode {
    pairmaskd::cli::main()
}
