package org.swarmwright.minisim;

import java.util.ArrayList;
import java.util.List;
import java.util.concurrent.Executors;
import java.util.concurrent.ScheduledExecutorService;
import java.util.concurrent.TimeUnit;
import java.util.logging.Level;
import java.util.logging.Logger;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.SimulationWrapper;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Fitness;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Parameters;
import org.swarmwright.messages.Sensor;
import org.swarmwright.messages.Server;

/** Minisim as a server that knows D6.1 and nothing else (its section 7.2.3). */
public final class MinisimSimulationWrapper extends SimulationWrapper {
  private static final Logger LOG = Logger.getLogger(MinisimSimulationWrapper.class.getName());

  private final Minisim minisim = new Minisim();
  private final ScheduledExecutorService clock = Executors.newSingleThreadScheduledExecutor();
  private Parameters parameters;
  private boolean running;
  private Float[] actuators;
  private int missing;
  private long waitingSince;

  /**
   * Connects and offers Minisim.
   *
   * @param server ID of the server, from 0
   */
  public MinisimSimulationWrapper(String broker, String prefix, long server) {
    super(broker, prefix);
    setServerInfo(
        new Server()
            .withServer(server)
            .withSimulations(List.of("minisim"))
            .withCapabilities(
                new Capabilities()
                    .withDimensions(2.0)
                    .withMaxAgents((double) minisim.description().maxAgents())));
    setAvailable(true);
    clock.scheduleWithFixedDelay(this::checkTime, 1, 1, TimeUnit.SECONDS);
  }

  /** Gives up a tool that has gone: D6.1 does not say when, docs/reference/protocol.md does. */
  private synchronized void checkTime() {
    long seconds = TimeUnit.NANOSECONDS.toSeconds(System.nanoTime() - waitingSince);
    if (!isAvailable() && seconds >= (running ? 60 : 5)) {
      LOG.log(Level.WARNING, "nothing came for {0} s; available again", seconds);
      end();
    }
  }

  /** What comes without a connection is lost, and with it the simulation. */
  @Override
  public synchronized void connectionLost(Throwable cause) {
    super.connectionLost(cause);
    end();
  }

  @Override
  public void close() {
    clock.shutdown();
    super.close();
  }

  @Override
  protected synchronized void handleParametersContent(Parameters parameters) {
    if (!running) {
      waitingSince = System.nanoTime();
      this.parameters = parameters;
      setAvailable(false);
    }
  }

  @Override
  protected synchronized void handleControlContent(Control control) {
    if (parameters == null || !control.getSimulationHash().equals(parameters.getSimulationHash())) {
      return;
    }
    if (!control.getRun()) {
      end();
    } else if (!running) {
      start();
    }
  }

  @Override
  protected synchronized void handleActuatorContent(Actuator actuator) {
    int[] acting = minisim.acting();
    for (int i = 0; running && i < acting.length; i++) {
      if (acting[i] == actuator.getAgent()
          && actuators[i] == null
          && actuator.getActuator().size() == 1) {
        float value = actuator.getActuator().get(0).floatValue();
        actuators[i] = Math.max(-1f, Math.min(1f, value));
        missing--;
      }
    }
    if (running && missing == 0) {
      step();
    }
  }

  private void start() {
    try {
      minisim.reset(new ParameterReader(Messages.problem(parameters)));
    } catch (ParameterException error) {
      LOG.log(Level.WARNING, "cannot start: {0}", error.getMessage());
      end();
      return;
    }
    running = true;
    sense();
  }

  private void step() {
    float[] all = new float[actuators.length];
    for (int i = 0; i < all.length; i++) {
      all[i] = actuators[i];
    }
    minisim.step(all);
    sense();
  }

  /** Publishes what the agents sense, or the fitness when none acts any more. */
  private void sense() {
    int[] acting = minisim.acting();
    actuators = new Float[acting.length];
    missing = acting.length;
    waitingSince = System.nanoTime();
    float[] sensors = new float[minisim.description().sensors()];
    for (int agent : acting) {
      minisim.sense(agent, sensors);
      List<Double> values = new ArrayList<>();
      for (float sensor : sensors) {
        values.add((double) sensor);
      }
      publishSensor(
          new Sensor()
              .withSimulation("minisim")
              .withSimulationHash(parameters.getSimulationHash())
              .withAgent((long) agent)
              .withSensor(values));
    }
    if (acting.length == 0) {
      Fitness fitness =
          new Fitness()
              .withSimulation("minisim")
              .withSimulationHash(parameters.getSimulationHash())
              .withFitness(minisim.fitness());
      // Available before the fitness is published: a tool may ask as soon as it receives it.
      end();
      publishFitness(fitness);
    }
  }

  private void end() {
    running = false;
    setAvailable(true);
  }
}
