// What the host learns of the rows of one of several GPUs. The other form is `share_noted_whole`.

fn note_rows() {
    atomicStore(&control[FIRST_ROW], first_row());
    atomicStore(&control[END_ROW], end_row());
}
