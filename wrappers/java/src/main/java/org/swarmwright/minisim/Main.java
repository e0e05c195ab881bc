package org.swarmwright.minisim;

import java.util.ArrayList;
import java.util.List;
import org.swarmwright.CommandLine;
import org.swarmwright.SimulationServer;

/**
 * The example server: Minisim; with {@code --plain} as a server that knows D6.1 and nothing else.
 */
public final class Main {
  private Main() {}

  /** Serves until it is told to end. */
  public static void main(String[] arguments) {
    List<String> rest = new ArrayList<>(List.of(arguments));
    if (rest.remove("--plain")) {
      CommandLine.run(
          rest.toArray(new String[0]),
          options -> {
            var server = new MinisimSimulationWrapper(options.broker, options.prefix, options.id);
            System.err.println("ready");
            return server;
          });
    } else {
      SimulationServer.main(arguments, Minisim::new);
    }
  }
}
