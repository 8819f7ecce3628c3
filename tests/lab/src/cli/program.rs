//! `program`: a client to record.

use clap::Args;
use pairmask::{Backend, Session};
use pairmaskd::cli::options::CommonOptions;

use crate::Result;
use crate::programs::Program as Name;

/// Run a small program as a client of the daemon that serves the instance, to record it
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  pairmaskd serve --instance city --record city.pmrec &
  pairmask-lab program city --instance city")]
pub struct Program {
    /// What it is like
    name: Name,
}

impl Program {
    pub fn run(&self, common: &CommonOptions) -> Result<()> {
        let builder = Session::builder().backend(Backend::Daemon).runtime_dir(common.runtime_dir());
        self.name.run(&mut builder.instance(common.instance().as_str()).connect()?)
    }
}
