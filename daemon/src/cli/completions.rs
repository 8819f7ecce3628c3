//! `completions`: what a shell needs to complete the command line.

use clap::Args;
use clap_complete::Shell;

use super::output::write_stdout;
use super::program::Result;
use super::shape;

/// Write a shell's completions to stdout
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd completions bash > ~/.local/share/bash-completion/completions/pairmaskd
  pairmaskd completions zsh > ~/.zfunc/_pairmaskd      a directory of $fpath
  pairmaskd completions fish > ~/.config/fish/completions/pairmaskd.fish")]
pub struct Completions {
    shell: Shell,
}

impl Completions {
    pub fn run(&self) -> Result {
        // Written as a whole: the generator has no errors, so that a reader that has ended would be a panic.
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut shape::listed(), "pairmaskd", &mut text);
        Ok(write_stdout(&text)?)
    }
}
