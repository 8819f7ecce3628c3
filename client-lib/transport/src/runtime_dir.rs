//! The directories that hold a user's instances by default.
//!
//! A daemon takes the first of its candidates; a client looks through all of its own, since the two
//! may have been started with different environments (a service, a shell, a container).

use std::path::{Path, PathBuf};

use crate::instance::RuntimeDir;
use crate::trust::check_directory;

/// Environment variable that names the one runtime directory to use.
const RUNTIME_DIR_VARIABLE: &str = "PAIRMASK_RUNTIME_DIR";
/// Environment variable of the user's run directory, by the XDG base directory specification.
const XDG_VARIABLE: &str = "XDG_RUNTIME_DIR";
/// Pairmask's directory in the user's run directory.
const XDG_FOLDER: &str = "pairmask";
/// Where the system keeps users' own directories.
pub(super) const USERS_RUN_DIR: &str = "/run/user";
/// The runtime directory of users without a run directory, less the user's id.
pub(super) const DEFAULT_PREFIX: &str = "/tmp/pairmask-";

/// The inputs of the choice: environment and user id.
struct Surroundings {
    named: Option<PathBuf>,
    xdg: Option<PathBuf>,
    run: PathBuf,
    user: u32,
}

impl Surroundings {
    fn of_process() -> Self {
        let user = rustix::process::geteuid().as_raw();
        let path = |variable| {
            std::env::var_os(variable).filter(|path| !path.is_empty()).map(PathBuf::from)
        };
        Self {
            named: path(RUNTIME_DIR_VARIABLE),
            xdg: path(XDG_VARIABLE),
            run: Path::new(USERS_RUN_DIR).join(user.to_string()),
            user,
        }
    }

    /// The directories in the order in which a client looks through them. A daemon uses the first.
    fn candidates(self) -> Vec<PathBuf> {
        if let Some(named) = self.named {
            return vec![named];
        }
        let is_usable = |path: &PathBuf| path.is_absolute() && check_directory(path).is_ok();
        let xdg = self.xdg.filter(is_usable);
        let in_tmp = PathBuf::from(format!("{DEFAULT_PREFIX}{}", self.user));
        // A process without the variable looks into the usual run directory too, but last: a daemon
        // must not serve there, because the system may remove that directory when the user logs
        // out.
        let run = Some(self.run).filter(is_usable).map(|path| path.join(XDG_FOLDER));
        let mut found: Vec<PathBuf> = Vec::new();
        let all = xdg.map(|path| path.join(XDG_FOLDER)).into_iter().chain([in_tmp]).chain(run);
        for path in all {
            if !found.contains(&path) {
                found.push(path);
            }
        }
        found
    }
}

impl RuntimeDir {
    /// `$PAIRMASK_RUNTIME_DIR`; else `pairmask` in `$XDG_RUNTIME_DIR`, where that is set and a
    /// directory of the user's own; else `/tmp/pairmask-UID`.
    ///
    /// Without `$PAIRMASK_RUNTIME_DIR`, a client looks through all of the others, and last into
    /// `/run/user/UID/pairmask`.
    pub fn from_env() -> Self {
        Self::first_of(Surroundings::of_process().candidates())
    }
}

impl<P: AsRef<Path>> From<P> for RuntimeDir {
    fn from(path: P) -> Self {
        Self::at(path.as_ref())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn the_order_is_named_then_xdg_then_tmp() {
        let own = std::env::temp_dir().join(format!("pairmask-order-{}", std::process::id()));
        fs::create_dir_all(&own).unwrap();
        fs::set_permissions(&own, PermissionsExt::from_mode(0o700)).unwrap();
        let nowhere = own.join("nowhere");
        let candidates = |named: Option<&Path>, xdg: Option<&Path>, run: &Path| {
            let path = |p: &Path| p.to_owned();
            let around = Surroundings {
                named: named.map(path),
                xdg: xdg.map(path),
                run: run.to_owned(),
                user: 7,
            };
            around.candidates()
        };
        let in_tmp = Path::new("/tmp/pairmask-7");
        let ours = own.join("pairmask");
        assert_eq!(candidates(Some(&nowhere), Some(&own), &own), [own.join("nowhere")]);
        assert_eq!(candidates(None, Some(&own), &nowhere), [ours.clone(), in_tmp.to_owned()]);
        assert_eq!(candidates(None, Some(&own), &own), [ours.clone(), in_tmp.to_owned()]);
        assert_eq!(candidates(None, None, &own), [in_tmp.to_owned(), ours.clone()]);
        // A directory that does not exist, is relative, or is open to others, counts as not set.
        assert_eq!(candidates(None, Some(&nowhere), &nowhere), [in_tmp]);
        assert_eq!(candidates(None, Some(Path::new(".")), &nowhere), [in_tmp]);
        fs::set_permissions(&own, PermissionsExt::from_mode(0o777)).unwrap();
        assert_eq!(candidates(None, Some(&own), &own), [in_tmp]);
        fs::remove_dir_all(own).unwrap();
    }
}
