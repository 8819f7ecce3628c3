// What the host learns of the rows of a GPU that has a frame alone: nothing that it does not know.

fn note_rows() {}
