//! Toolchain and commit of this build.

use std::sync::LazyLock;

use pairmask_wire::Version;

pub const TOOLCHAIN: &str = env!("PAIRMASK_TOOLCHAIN");
/// The commit, as `git describe` names it, or `unknown`.
pub const COMMIT: &str = env!("PAIRMASK_COMMIT");

static VERSION: LazyLock<String> = LazyLock::new(|| {
    format!("{} (wire {}, commit {COMMIT})", env!("CARGO_PKG_VERSION"), Version::CURRENT)
});

pub fn version() -> &'static str {
    &VERSION
}
