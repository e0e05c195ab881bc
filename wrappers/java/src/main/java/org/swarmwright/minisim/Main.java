package org.swarmwright.minisim;

import java.util.ArrayList;
import java.util.List;
import org.swarmwright.CommandLine;
import org.swarmwright.SimulationServer;

/** The example server: Minisim; with {@code --plain} as a server of the D6.1 profile. */
public final class Main {
  private Main() {}

  /** Serves until it is terminated. */
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
