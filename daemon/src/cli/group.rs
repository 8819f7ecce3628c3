//! Groups of users, by number or name.

use std::str::FromStr;

/// Where the system names groups. Those of a directory service have to be named by their number.
const GROUPS: &str = "/etc/group";

/// The id of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroupId(pub u32);

impl FromStr for GroupId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(number) = text.parse() {
            return Ok(Self(number));
        }
        let groups = std::fs::read(GROUPS).map_err(|error| format!("{GROUPS}: {error}"))?;
        named(&String::from_utf8_lossy(&groups), text).map(Self).ok_or_else(|| {
            format!("no group in {GROUPS} is called '{text}': name it, or give its number")
        })
    }
}

/// The number of a name in the text of [`GROUPS`].
fn named(groups: &str, name: &str) -> Option<u32> {
    let of_line = |line: &str| {
        let mut fields = line.split(':');
        (fields.next()? == name).then_some(())?;
        fields.nth(1)?.parse().ok()
    };
    groups.lines().find_map(of_line)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_found_by_number_and_by_name() {
        let groups = "root:x:0:\n# users:x:7:\nusers:x:100:a,b\nbroken:x\n";
        let found = ["root", "users", "broken", "nobody", ""].map(|name| named(groups, name));
        assert_eq!(found, [Some(0), Some(100), None, None, None]);
        assert_eq!("4711".parse(), Ok(GroupId(4711)));
        assert!("no such group".parse::<GroupId>().is_err());
    }
}
