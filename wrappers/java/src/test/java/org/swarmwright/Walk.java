package org.swarmwright;

/** Adds up what its agent does; breaks where the seed is 13. */
public final class Walk implements Simulation {
  private long seed;
  private double sum;
  private int step;

  @Override
  public Description description() {
    return Description.of("walk", 2, 1, 1).withMetrics("half");
  }

  @Override
  public void reset(ParameterReader parameters) {
    seed = parameters.seed("seed");
    sum = parameters.integer("start", 0, 9, 0);
    step = 0;
  }

  @Override
  public int[] acting() {
    return step < 2 ? new int[] {0} : new int[0];
  }

  @Override
  public void sense(int agent, float[] sensors) {
    sensors[0] = 1f;
  }

  @Override
  public void step(float[] actuators) {
    if (seed == 13) {
      throw new UnsupportedOperationException("no thirteen");
    }
    sum += actuators[0];
    step++;
  }

  @Override
  public double fitness() {
    return sum;
  }

  @Override
  public double[] metrics() {
    return new double[] {sum / 2};
  }
}
