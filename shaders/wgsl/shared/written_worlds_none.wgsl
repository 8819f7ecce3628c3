// Where the items of each world begin, in a frame without rules: nothing is said. The other form is
// `written_worlds_ruled`.

fn report_worlds(row: u32, first_entry: u32) {}
