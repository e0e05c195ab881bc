package org.swarmwright;

import java.io.IOException;

/** Adds up what its agent does; breaks in another way for each of the seeds 13 to 17. */
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
    if (seed == 16) {
      Walk.<RuntimeException>sneak(new IOException("no sixteen"));
    }
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
    } else if (seed == 14) {
      throw new Error("no fourteen");
    } else if (seed == 15) {
      Walk.<RuntimeException>sneak(new IOException("no fifteen"));
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
    return seed == 17 ? new double[] {1, 2} : new double[] {sum / 2};
  }

  /** Throws a checked exception that no method declares, as Kotlin and Lombok do. */
  @SuppressWarnings("unchecked")
  private static <E extends Throwable> void sneak(Throwable error) throws E {
    throw (E) error;
  }
}
