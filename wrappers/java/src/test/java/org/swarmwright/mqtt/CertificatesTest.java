package org.swarmwright.mqtt;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertNotNull;
import static org.junit.jupiter.api.Assertions.assertSame;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;
import static org.junit.jupiter.api.Assumptions.assumeTrue;

import java.io.IOException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.Provider;
import java.security.Security;
import java.util.ArrayList;
import java.util.List;
import javax.net.ssl.SSLContext;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.io.TempDir;

class CertificatesTest {
  private static final String CERTIFICATE = "SWARMWRIGHT_CERTIFICATE_FILE";
  private static final String KEY = "SWARMWRIGHT_KEY_FILE";
  private static final String[] EC = {"ec", "-pkeyopt", "ec_paramgen_curve:P-256"};
  private static final String[] RSA = {"rsa:2048"};

  @TempDir Path folder;

  @Test
  void withoutFilesTheKeyAndTrustStoresOfJavaAreUsed() throws Exception {
    assertSame(SSLContext.getDefault(), Certificates.context(null, null, null));
  }

  @Test
  void certificatesAreUsedWithTheirKeys() throws Exception {
    List<String[]> algorithms = new ArrayList<>(List.of(EC, RSA));
    if (Runtime.version().feature() >= 15) {
      algorithms.add(new String[] {"ed25519"});
    }
    for (String[] algorithm : algorithms) {
      String name = algorithm[0].replace(":", "");
      make(name, algorithm);
      assertNotNull(Certificates.context(null, certificate(name), key(name)));
    }
  }

  @Test
  void theKeyOfAnotherCertificateIsRefused() throws Exception {
    make("own", EC);
    make("other", EC);
    make("rsa", RSA);
    make("other-rsa", RSA);
    for (String[] pair : new String[][] {{"own", "other"}, {"own", "rsa"}, {"rsa", "other-rsa"}}) {
      String message = refusal(certificate(pair[0]), key(pair[1]));
      assertEquals(
          KEY
              + " "
              + key(pair[1])
              + " cannot be used: it is not the key of the certificate "
              + CERTIFICATE
              + " "
              + certificate(pair[0]),
          message);
    }
  }

  @Test
  void aChainInAnotherOrderIsNamed() throws Exception {
    make("authority", EC);
    make("own", EC);
    String chain = folder.resolve("chain.pem").toString();
    Files.writeString(
        Path.of(chain),
        Files.readString(Path.of(certificate("authority")))
            + Files.readString(Path.of(certificate("own"))));
    String message = refusal(chain, key("own"));
    assertTrue(message.startsWith(CERTIFICATE + " " + chain + " cannot be used: "), message);
    assertTrue(message.contains("comes first"), message);
  }

  /** As Java before version 15 has no Ed25519. */
  @Test
  void keysOfAlgorithmsThatJavaDoesNotHaveAreNamed() throws Exception {
    make("own", EC);
    Provider provider = Security.getProvider("SunEC");
    assumeTrue(provider != null);
    int position = List.of(Security.getProviders()).indexOf(provider) + 1;
    Security.removeProvider(provider.getName());
    try {
      String message = refusal(certificate("own"), key("own"));
      assertTrue(message.startsWith(KEY + " " + key("own") + " cannot be used: "), message);
      assertTrue(message.contains("Ed25519"), message);
    } finally {
      Security.insertProviderAt(provider, position);
    }
  }

  @Test
  void oneOfCertificateAndKeyIsNotEnough() {
    assertTrue(refusal("own.pem", null).contains(KEY + " is not"));
    assertTrue(refusal(null, "key.pem").contains(CERTIFICATE + " is not"));
  }

  private static String refusal(String certificate, String key) {
    return assertThrows(
            IllegalArgumentException.class, () -> Certificates.context(null, certificate, key))
        .getMessage();
  }

  private String certificate(String name) {
    return folder.resolve(name + ".pem").toString();
  }

  private String key(String name) {
    return folder.resolve(name + "-key.pem").toString();
  }

  /** Makes a certificate that is signed by its own key. */
  private void make(String name, String[] algorithm) throws IOException, InterruptedException {
    List<String> command = new ArrayList<>(List.of("openssl", "req", "-x509", "-newkey"));
    command.addAll(List.of(algorithm));
    command.addAll(List.of("-noenc", "-subj", "/CN=" + name, "-days", "2"));
    command.addAll(List.of("-keyout", key(name), "-out", certificate(name)));
    Process process = new ProcessBuilder(command).redirectErrorStream(true).start();
    String output = new String(process.getInputStream().readAllBytes());
    assertEquals(0, process.waitFor(), output);
  }
}
