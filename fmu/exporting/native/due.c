/* What ticks when. The numbers of the programs and the tables of the clocks stand before. */

/* Which program samples when a set of clocks ticks; clock i is bit i of the code. Many clocks share the
   first program, with all bits set: it knows itself what ticks. */
static const struct { unsigned long long code; int program; } tf_sets[] = {TF_SET_TABLE};

/* The program that samples what ticks at a grid point; 0 if nothing does. This and tf_next_due are
   the calendar of `Schedule` in blocks/simulation/schedule.py, for where there is no Python. */
static int tf_due(long long k) {
  unsigned long long code = 0;
  for (int i = 0; i < TF_CLOCKS; ++i)
    if (k >= tf_clocks[i].offset && (k - tf_clocks[i].offset) % tf_clocks[i].period == 0)
      code |= tf_sets[0].code == ~0ull ? ~0ull : 1ull << i;
  if (code)
    for (int i = 0; i < TF_SETS; ++i)
      if (tf_sets[i].code == code) return tf_sets[i].program;
  return 0;
}
