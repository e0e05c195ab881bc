package org.swarmwright.mqtt;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.IOException;
import java.security.cert.CertificateException;
import java.util.Map;
import javax.net.ssl.SSLHandshakeException;
import org.junit.jupiter.api.Test;

class BrokerAddressTest {
  private static final String KEEP_ALIVE = "SWARMWRIGHT_KEEP_ALIVE";

  @Test
  void severalAddressesAreThoseOfACluster() {
    BrokerAddress address = BrokerAddress.of("mqtt://one, two:1884,ws://three", Map.of());
    assertEquals("tcp://one:1883 or tcp://two:1884 or ws://three:80/mqtt", address.toString());
  }

  @Test
  void theKeepAliveIntervalIsThatOfTheEnvironment() {
    assertEquals(20, BrokerAddress.of("mqtt://lab", Map.of()).keepAlive());
    assertEquals(5, BrokerAddress.of("mqtt://lab", Map.of(KEEP_ALIVE, "5")).keepAlive());
    for (String wrong : new String[] {"0", "3601", "2.5", "often"}) {
      BrokerAddress address = BrokerAddress.of("mqtt://lab", Map.of(KEEP_ALIVE, wrong));
      assertThrows(IllegalArgumentException.class, address::keepAlive, wrong);
    }
  }

  @Test
  void whatIsWrongIsNamed() {
    for (Map.Entry<String, String> wrong :
        Map.of(
                "http://lab", "the scheme must be",
                "unix:///run/mosquitto.sock", "cannot use Unix sockets",
                "mqtt://lab,unix:///run/mosquitto.sock", "cannot use Unix sockets",
                "mqtt://me:secret@lab", "credentials do not belong in a URL",
                "mqtts://one,mqtt://two", "must be encrypted")
            .entrySet()) {
      String said =
          assertThrows(
                  IllegalArgumentException.class, () -> BrokerAddress.of(wrong.getKey(), Map.of()))
              .getMessage();
      assertTrue(said.contains(wrong.getValue()), said);
      assertTrue(!said.contains("secret"), said);
    }
  }

  @Test
  void adviceIsForWhatWentWrong() {
    String address = "is this its address?";
    assertTrue(BrokerAddress.advice(null).contains(address));
    assertTrue(BrokerAddress.advice(new IOException("Connection refused")).contains(address));
    String ended = "Remote host terminated the handshake";
    assertTrue(BrokerAddress.advice(new SSLHandshakeException(ended)).contains(address));
    SSLHandshakeException refused =
        new SSLHandshakeException("Received fatal alert: certificate_required");
    String advice = BrokerAddress.advice(refused);
    assertTrue(advice.contains("SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE"), advice);
    assertTrue(!advice.contains(address), advice);
    SSLHandshakeException unknown = new SSLHandshakeException("PKIX path building failed");
    unknown.initCause(new CertificateException("unable to find valid certification path"));
    assertTrue(BrokerAddress.advice(unknown).contains("SWARMWRIGHT_CA_FILE"));
  }
}
