package org.swarmwright.mqtt;

import java.io.ByteArrayInputStream;
import java.io.IOException;
import java.nio.charset.StandardCharsets;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.GeneralSecurityException;
import java.security.KeyFactory;
import java.security.KeyStore;
import java.security.KeyStoreException;
import java.security.NoSuchAlgorithmException;
import java.security.PrivateKey;
import java.security.PublicKey;
import java.security.Signature;
import java.security.SignatureException;
import java.security.cert.Certificate;
import java.security.cert.CertificateException;
import java.security.cert.CertificateFactory;
import java.security.spec.InvalidKeySpecException;
import java.security.spec.PKCS8EncodedKeySpec;
import java.util.ArrayList;
import java.util.Base64;
import java.util.List;
import java.util.Map;
import java.util.regex.Matcher;
import java.util.regex.Pattern;
import javax.net.ssl.KeyManager;
import javax.net.ssl.KeyManagerFactory;
import javax.net.ssl.SSLContext;
import javax.net.ssl.TrustManager;
import javax.net.ssl.TrustManagerFactory;

/** TLS from PEM files: the authority of the broker, and the certificate of this client. */
final class Certificates {
  private static final Pattern KEY =
      Pattern.compile("-----BEGIN PRIVATE KEY-----([^-]*)-----END PRIVATE KEY-----");
  private static final String[] ALGORITHMS = {"EC", "RSA", "Ed25519"};

  /** By what keys say of themselves. */
  private static final Map<String, String> SIGNATURES =
      Map.of("EC", "SHA256withECDSA", "RSA", "SHA256withRSA", "EdDSA", "EdDSA");

  private Certificates() {}

  /**
   * What connections are made with. Where no file is given, it is what Java itself uses, with the
   * system properties javax.net.ssl.keyStore and javax.net.ssl.trustStore.
   *
   * @param authority file of the authorities that may have signed the broker's certificate; null
   *     for those of Java
   * @param certificate file of the client's certificate; null for none
   * @param key file of its private key, PKCS #8, not encrypted; null for none
   * @throws IllegalArgumentException if a file cannot be used, one of certificate and key is
   *     missing, or they do not belong together
   */
  static SSLContext context(String authority, String certificate, String key) {
    if ((certificate == null) != (key == null)) {
      String set = key == null ? "SWARMWRIGHT_CERTIFICATE_FILE" : "SWARMWRIGHT_KEY_FILE";
      String unset = key == null ? "SWARMWRIGHT_KEY_FILE" : "SWARMWRIGHT_CERTIFICATE_FILE";
      throw new IllegalArgumentException(
          set + " is set but " + unset + " is not; a client certificate needs both (PEM)");
    }
    try {
      if (authority == null && certificate == null) {
        return SSLContext.getDefault();
      }
      TrustManager[] trusted = authority == null ? null : trusting(authority);
      KeyManager[] own = certificate == null ? null : identity(certificate, key);
      SSLContext context = SSLContext.getInstance("TLS");
      context.init(own, trusted, null);
      return context;
    } catch (GeneralSecurityException | IOException error) {
      throw new IllegalArgumentException("TLS cannot be used: " + error.getMessage());
    }
  }

  private static TrustManager[] trusting(String file) throws GeneralSecurityException, IOException {
    KeyStore store = empty();
    int index = 0;
    for (Certificate certificate : certificates("SWARMWRIGHT_CA_FILE", file)) {
      store.setCertificateEntry("authority-" + index++, certificate);
    }
    TrustManagerFactory factory =
        TrustManagerFactory.getInstance(TrustManagerFactory.getDefaultAlgorithm());
    factory.init(store);
    return factory.getTrustManagers();
  }

  private static KeyManager[] identity(String certificate, String key)
      throws GeneralSecurityException, IOException {
    Certificate[] chain =
        certificates("SWARMWRIGHT_CERTIFICATE_FILE", certificate).toArray(new Certificate[0]);
    PrivateKey own = privateKey(key);
    KeyStore store = empty();
    char[] none = new char[0];
    try {
      store.setKeyEntry("client", own, none, chain);
    } catch (KeyStoreException error) {
      throw unusable(
          "SWARMWRIGHT_CERTIFICATE_FILE",
          certificate,
          error.getMessage()
              + "; the client's certificate comes first, then those of intermediate authorities,"
              + " each followed by that of its issuer");
    }
    if (!isPair(own, chain[0].getPublicKey())) {
      throw unusable(
          "SWARMWRIGHT_KEY_FILE",
          key,
          "it is not the key of the certificate SWARMWRIGHT_CERTIFICATE_FILE " + certificate);
    }
    KeyManagerFactory factory =
        KeyManagerFactory.getInstance(KeyManagerFactory.getDefaultAlgorithm());
    factory.init(store, none);
    return factory.getKeyManagers();
  }

  /** Whether the public key verifies what the private key has signed. */
  private static boolean isPair(PrivateKey own, PublicKey open) throws GeneralSecurityException {
    if (!own.getAlgorithm().equals(open.getAlgorithm())) {
      return false;
    }
    Signature signature = Signature.getInstance(SIGNATURES.get(own.getAlgorithm()));
    byte[] message = {1, 2, 3};
    signature.initSign(own);
    signature.update(message);
    byte[] signed = signature.sign();
    signature.initVerify(open);
    signature.update(message);
    try {
      return signature.verify(signed);
    } catch (SignatureException error) {
      return false; // Of another length.
    }
  }

  private static KeyStore empty() throws GeneralSecurityException, IOException {
    KeyStore store = KeyStore.getInstance(KeyStore.getDefaultType());
    store.load(null, null);
    return store;
  }

  private static List<Certificate> certificates(String variable, String file)
      throws CertificateException {
    byte[] content = read(variable, file);
    try {
      List<Certificate> found =
          new ArrayList<>(
              CertificateFactory.getInstance("X.509")
                  .generateCertificates(new ByteArrayInputStream(content)));
      if (found.isEmpty()) {
        throw unusable(variable, file, "it contains no certificate");
      }
      return found;
    } catch (CertificateException error) {
      throw unusable(variable, file, error.getMessage());
    }
  }

  private static PrivateKey privateKey(String file) {
    String variable = "SWARMWRIGHT_KEY_FILE";
    String content = new String(read(variable, file), StandardCharsets.US_ASCII);
    Matcher matcher = KEY.matcher(content);
    if (!matcher.find()) {
      throw unusable(
          variable,
          file,
          "there is no block \"BEGIN PRIVATE KEY\" in it (PKCS #8 without a passphrase); `openssl"
              + " pkcs8 -topk8 -nocrypt -in FILE -out FILE` converts other keys");
    }
    byte[] bytes;
    try {
      bytes = Base64.getMimeDecoder().decode(matcher.group(1));
    } catch (IllegalArgumentException error) {
      throw unusable(variable, file, error.getMessage());
    }
    for (String algorithm : ALGORITHMS) {
      try {
        return KeyFactory.getInstance(algorithm).generatePrivate(new PKCS8EncodedKeySpec(bytes));
      } catch (InvalidKeySpecException | NoSuchAlgorithmException error) {
        // Of another kind; before Java 15 there is no Ed25519.
      }
    }
    throw unusable(variable, file, "it is not a key for EC, RSA or (Java 15 or newer) Ed25519");
  }

  private static byte[] read(String variable, String file) {
    try {
      return Files.readAllBytes(Path.of(file));
    } catch (IOException error) {
      throw unusable(variable, file, "cannot be read: " + error.getMessage());
    }
  }

  private static IllegalArgumentException unusable(String variable, String file, String why) {
    return new IllegalArgumentException(variable + " " + file + " cannot be used: " + why);
  }
}
