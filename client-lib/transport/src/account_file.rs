//! The daemon's account of itself as a file of the runtime directory, so that `pairmaskd status`
//! needs no client's slot, and can tell of a daemon that hangs.
//!
//! The file is replaced as a whole, never mapped. It is read as anything from outside is: copied
//! once and checked.

use std::path::PathBuf;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use pairmask_wire::{InstanceError, InstanceName, StatusBody};
use rustix::time::{ClockId, clock_gettime};

use crate::instance::RuntimeDir;
use crate::trust::{read_own, replace_own};

/// "PMAC" in memory order.
const MAGIC: u32 = u32::from_le_bytes(*b"PMAC");

/// The daemon's account of itself, and when it gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Account {
    magic: u32,
    /// Length of this build's account; a later one may be longer.
    bytes: u32,
    noted_at_ns: u64,
    body: StatusBody,
}

const _: () = assert!(size_of::<Account>() == 16 + size_of::<StatusBody>());

/// The system's monotonic clock, which all processes share, ns.
fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec.unsigned_abs() as u32).as_nanos() as u64
}

impl Account {
    /// An account that is given now.
    pub fn now(body: StatusBody) -> Self {
        Self { magic: MAGIC, bytes: size_of::<Self>() as u32, noted_at_ns: now_ns(), body }
    }

    /// What the daemon said of itself.
    pub const fn body(&self) -> &StatusBody {
        &self.body
    }

    /// How long ago; zero for one from the future.
    pub fn age(&self) -> Duration {
        Duration::from_nanos(now_ns().saturating_sub(self.noted_at_ns))
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let account: Self = bytemuck::pod_read_unaligned(bytes.get(..size_of::<Self>())?);
        let is_one = account.magic == MAGIC && account.bytes as usize >= size_of::<Self>();
        is_one.then_some(account)
    }
}

impl RuntimeDir {
    pub(super) fn account_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".account")
    }

    /// Puts the account of an instance in place in one step.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn write_account(
        &self,
        name: &InstanceName,
        account: &Account,
    ) -> Result<(), InstanceError> {
        let new = self.file(name, ".account.new");
        replace_own(&new, &self.account_file(name), bytemuck::bytes_of(account))
    }

    /// The account of an instance, or `None` where there is none or it cannot be understood.
    ///
    /// # Errors
    /// [`InstanceError`] where it is not ours.
    pub fn account(&self, name: &InstanceName) -> Result<Option<Account>, InstanceError> {
        let bytes = read_own(&self.account_file(name), size_of::<Account>() as u64)?;
        Ok(bytes.as_deref().and_then(Account::parse))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_account_round_trips_and_junk_is_none() {
        let account = Account::now(StatusBody { frames: 7, ..StatusBody::default() });
        let bytes = bytemuck::bytes_of(&account);
        assert_eq!(Account::parse(bytes), Some(account));
        assert_eq!(
            Account::parse(&[bytes, &[1; 64]].concat()),
            Some(account),
            "a later, longer one"
        );
        assert!(account.age() < Duration::from_secs(3600));
        assert_eq!(Account::parse(&bytes[1..]), None);
        assert_eq!(Account::parse(&bytes[..bytes.len() - 1]), None);
        assert_eq!(Account::parse(&[]), None);
        assert_eq!(Account::parse(&vec![0; bytes.len()]), None);
    }
}
