package org.swarmwright.mqtt;

import java.io.IOException;
import java.net.URI;
import java.net.URISyntaxException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.cert.CertificateException;
import java.util.ArrayList;
import java.util.List;
import java.util.Locale;
import java.util.Map;
import javax.net.SocketFactory;
import javax.net.ssl.SSLContext;
import javax.net.ssl.SSLHandshakeException;

/**
 * The URL of a broker, or those of the brokers of a cluster, and the credentials from environment
 * variables.
 *
 * <p>SWARMWRIGHT_USERNAME, SWARMWRIGHT_PASSWORD or SWARMWRIGHT_PASSWORD_FILE (its first line),
 * SWARMWRIGHT_CA_FILE, SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE (PEM),
 * SWARMWRIGHT_KEEP_ALIVE (seconds).
 */
public final class BrokerAddress {
  private static final Map<String, String> SCHEMES =
      Map.of(
          "mqtt", "tcp", "tcp", "tcp", "mqtts", "ssl", "ssl", "ssl", "tls", "ssl", "ws", "ws",
          "wss", "wss");
  private static final Map<String, Integer> PORTS =
      Map.of("tcp", 1883, "ssl", 8883, "ws", 80, "wss", 443);

  private static final int KEEP_ALIVE_S = 20;
  private static final int LONGEST_KEEP_ALIVE_S = 3600;

  private final List<String> uris;
  private final boolean tls;
  private final Map<String, String> environment;

  private BrokerAddress(List<String> uris, boolean tls, Map<String, String> environment) {
    this.uris = uris;
    this.tls = tls;
    this.environment = environment;
  }

  /**
   * Reads mqtt://, mqtts://, ws:// or wss://, host and optional port; without a scheme mqtt:// is
   * meant. Several, separated by commas, are the brokers of a cluster: the first that can be
   * reached is used.
   *
   * @throws IllegalArgumentException if one is not such a URL, or contains credentials, or only
   *     some are encrypted
   */
  public static BrokerAddress of(String urls) {
    return of(urls, System.getenv());
  }

  static BrokerAddress of(String urls, Map<String, String> environment) {
    List<String> uris = new ArrayList<>();
    for (String url : urls.split(",", -1)) {
      uris.add(uriOf(url.strip()));
    }
    boolean tls = isEncrypted(uris.get(0));
    if (uris.stream().anyMatch(uri -> isEncrypted(uri) != tls)) {
      throw new IllegalArgumentException(
          "broker URLs: all brokers of a cluster must be encrypted (mqtts://, wss://), or none");
    }
    return new BrokerAddress(List.copyOf(uris), tls, environment);
  }

  private static boolean isEncrypted(String uri) {
    return uri.startsWith("ssl:") || uri.startsWith("wss:");
  }

  private static String uriOf(String url) {
    String shown = url.contains("@") ? "...@" + url.substring(url.lastIndexOf('@') + 1) : url;
    URI parsed;
    try {
      parsed = new URI(url.contains("://") ? url : "mqtt://" + url);
    } catch (URISyntaxException error) {
      throw wrong(shown, "expected HOST or HOST:PORT after the scheme");
    }
    String scheme = SCHEMES.get(parsed.getScheme().toLowerCase(Locale.ROOT));
    if (scheme == null && parsed.getScheme().equalsIgnoreCase("unix")) {
      throw wrong(
          shown,
          "servers in Java cannot use Unix sockets, which the MQTT library (Eclipse Paho) does not"
              + " have; use mqtt://localhost:1883, on which the broker must listen too");
    }
    if (scheme == null) {
      throw wrong(shown, "the scheme must be mqtt://, mqtts://, ws:// or wss://");
    }
    if (url.contains("@")) {
      throw wrong(
          shown,
          "credentials do not belong in a URL; set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD"
              + " instead");
    }
    if (parsed.getHost() == null || parsed.getPort() == 0 || parsed.getPort() > 65535) {
      throw wrong(shown, "expected HOST or HOST:PORT, the port from 1 to 65535");
    }
    boolean web = scheme.startsWith("ws");
    String query = parsed.getQuery() == null ? "" : parsed.getQuery();
    if (!query.isEmpty() && !query.equals("mqtt=5")) {
      throw wrong(shown, "servers in Java speak MQTT 5 only; the only query is ?mqtt=5");
    }
    String path = parsed.getPath() == null ? "" : parsed.getPath();
    if (!web && path.length() > 1) {
      throw wrong(shown, "mqtt:// and mqtts:// take no path; use a prefix for topics");
    }
    int port = parsed.getPort() < 0 ? PORTS.get(scheme) : parsed.getPort();
    String target = web ? (path.length() > 1 ? path : "/mqtt") : "";
    return scheme + "://" + parsed.getHost() + ":" + port + target;
  }

  private static IllegalArgumentException wrong(String url, String reason) {
    return new IllegalArgumentException("broker URL \"" + url + "\": " + reason);
  }

  /** The address as Paho spells it; of a cluster the first. */
  public String uri() {
    return uris.get(0);
  }

  /** All addresses as Paho spells them, in the order in which they are tried. */
  public String[] uris() {
    return uris.toArray(new String[0]);
  }

  /** The user name; null for none. */
  public String username() {
    return variable("SWARMWRIGHT_USERNAME");
  }

  /**
   * The password; null for none.
   *
   * @throws IllegalArgumentException if it is in a file that cannot be read, or the user name is
   *     not set
   */
  public String password() {
    String password = variable("SWARMWRIGHT_PASSWORD");
    String file = variable("SWARMWRIGHT_PASSWORD_FILE");
    if (password == null && file != null) {
      try {
        List<String> lines = Files.readAllLines(Path.of(file));
        password = lines.isEmpty() ? "" : lines.get(0);
      } catch (IOException error) {
        throw new IllegalArgumentException(
            "SWARMWRIGHT_PASSWORD_FILE " + file + " cannot be read: " + error.getMessage());
      }
    }
    if (password != null && username() == null) {
      throw new IllegalArgumentException(
          "a password is set but SWARMWRIGHT_USERNAME is not; set both or neither");
    }
    return password;
  }

  /**
   * The keep-alive interval, seconds.
   *
   * @throws IllegalArgumentException if it is not a whole number from 1 to 3600
   */
  public int keepAlive() {
    String text = variable("SWARMWRIGHT_KEEP_ALIVE");
    if (text == null) {
      return KEEP_ALIVE_S;
    }
    if (!text.matches("[1-9][0-9]{0,3}") || Integer.parseInt(text) > LONGEST_KEEP_ALIVE_S) {
      throw new IllegalArgumentException(
          "SWARMWRIGHT_KEEP_ALIVE: expected whole seconds from 1 to 3600, not \"" + text + "\"");
    }
    return Integer.parseInt(text);
  }

  /**
   * A factory of sockets that send at once.
   *
   * @throws IllegalArgumentException if the certificate authority, the client certificate or its
   *     key cannot be used
   */
  public SocketFactory sockets() {
    if (!tls) {
      return new PromptSockets();
    }
    SSLContext context =
        Certificates.context(
            variable("SWARMWRIGHT_CA_FILE"),
            variable("SWARMWRIGHT_CERTIFICATE_FILE"),
            variable("SWARMWRIGHT_KEY_FILE"));
    return new PromptTlsSockets(context.getSocketFactory());
  }

  /**
   * What to do about a connection to a broker that failed.
   *
   * @param cause of the MQTT library's exception; null for none
   */
  public static String advice(Throwable cause) {
    if (cause instanceof SSLHandshakeException) {
      if (cause.getCause() instanceof CertificateException) {
        return "name the authority that signed the broker's certificate with SWARMWRIGHT_CA_FILE,"
            + " and connect by a name that is in the certificate";
      }
      if (String.valueOf(cause.getMessage()).startsWith("Received fatal alert")) {
        return "if the broker requires a client certificate, set SWARMWRIGHT_CERTIFICATE_FILE and"
            + " SWARMWRIGHT_KEY_FILE: an authority that the broker trusts must have signed it, and"
            + " it must be valid now";
      }
    }
    return "is it running, and is this its address?";
  }

  private String variable(String name) {
    String value = environment.get(name);
    return value == null || value.isEmpty() ? null : value;
  }

  @Override
  public String toString() {
    return String.join(" or ", uris);
  }
}
