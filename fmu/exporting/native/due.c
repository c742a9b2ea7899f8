/* Sampling schedule. The numbers of the programs and the tables of the clocks precede this file. */

/* Sample program of each set of clocks; clock i is bit i of the code. */
static const struct { unsigned long long code; int program; } tf_sets[] = {TF_SET_TABLE};

/* Return the sample program of a grid point, or 0 if no clock ticks. This and tf_next_due are the
   counterpart of `Schedule` in blocks/simulation/schedule.py. */
static int tf_due(long long k) {
  unsigned long long code = 0;
  for (int i = 0; i < TF_CLOCKS; ++i)
    if (k >= tf_clocks[i].offset && (k - tf_clocks[i].offset) % tf_clocks[i].period == 0)
      code |= 1ull << i;
  if (code)
    for (int i = 0; i < TF_SETS; ++i)
      if (tf_sets[i].code == code) return tf_sets[i].program;
  return 0;
}
