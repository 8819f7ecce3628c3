/* A child that is forked from a program drops what that holds, and asks by itself: the answer of its parent stays. */
#define _POSIX_C_SOURCE 200112L

#include "check.h"

#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#define BOXES 5000

/* Submits boxes in a row, each of which overlaps so many of those behind it. */
static pm_pending submitted(pm_session session, uint32_t overlapped) {
  pm_frame frame;
  pm_pending pending;
  pm_box *boxes;
  EXPECT(PM_OK, pm_session_frame(session, BOXES, &frame, &boxes));
  for (uint32_t i = 0; i < BOXES; i++) {
    const float x = (float)i;
    boxes[i] = (pm_box){{x, 0, 0}, {x + (float)overlapped + 0.5f, 1, 1}};
  }
  EXPECT(PM_OK, pm_frame_submit(frame, NULL, &pending));
  return pending;
}

static void check_pairs(pm_mask mask, uint32_t overlapped) {
  const pm_pair *pairs;
  size_t count;
  EXPECT(PM_OK, pm_mask_pairs(mask, &pairs, &count));
  CHECK(count == (size_t)overlapped * BOXES - (size_t)overlapped * (overlapped + 1) / 2);
}

static void cull(pm_session session, uint32_t overlapped) {
  pm_mask mask;
  EXPECT(PM_OK, pm_pending_wait(submitted(session, overlapped), &mask));
  check_pairs(mask, overlapped);
  EXPECT(PM_OK, pm_mask_drop(mask));
}

int main(int argc, char **argv) {
  const pm_session_options options = options_of(argc, argv);
  pm_session session;
  EXPECT(PM_OK, pm_session_connect(&options, &session));
  for (uint32_t round = 0; round < 3; round++) {
    pm_mask mask;
    EXPECT(PM_OK, pm_pending_wait(submitted(session, 3), &mask));
    /* An answer for which the daemon makes more memory, and says so once. */
    const pm_pending under_way = submitted(session, BOXES - 1);
    const pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
      EXPECT(PM_OK, pm_mask_drop(mask));
      /* It gets no answer by the connection of its parent. */
      CHECK(pm_pending_wait(under_way, &mask) != PM_OK);
      pm_session own;
      EXPECT(PM_OK, pm_session_connect(&options, &own));
      for (int i = 0; i < 3; i++) {
        cull(own, 4);
      }
      EXPECT(PM_OK, pm_session_drop(own));
      EXPECT(PM_OK, pm_session_drop(session));
      /* Without what programs do at their end, as a child should. */
      _exit(0);
    }
    int status;
    CHECK(waitpid(child, &status, 0) == child && status == 0);
    /* The daemon writes these answers to memory that was let go of. */
    for (int i = 0; i < 10; i++) {
      cull(session, 7);
    }
    check_pairs(mask, 3);
    EXPECT(PM_OK, pm_mask_drop(mask));
    EXPECT(PM_OK, pm_pending_wait(under_way, &mask));
    check_pairs(mask, BOXES - 1);
    EXPECT(PM_OK, pm_mask_drop(mask));
  }
  EXPECT(PM_OK, pm_session_drop(session));
  puts("parents and children");
  return 0;
}
