{{- define "swarmwright.name" -}}
{{- if contains "swarmwright" .Release.Name -}}
{{ .Release.Name | trunc 40 | trimSuffix "-" }}
{{- else -}}
{{ printf "%s-swarmwright" (.Release.Name | trunc 28 | trimSuffix "-") }}
{{- end -}}
{{- end -}}

{{- define "swarmwright.broker" -}}
{{ include "swarmwright.name" . }}-broker
{{- end -}}

{{- define "swarmwright.claim" -}}
{{ .Values.tool.persistence.existingClaim | default (printf "%s-runs" (include "swarmwright.name" .)) }}
{{- end -}}

{{/* Another experiment is another job: the pods of a job cannot be changed. */}}
{{- define "swarmwright.run" -}}
{{ printf "%s %s" .Values.tool.experiment (join " " .Values.tool.arguments) | sha256sum | trunc 8 }}
{{- end -}}

{{- define "swarmwright.selector" -}}
app.kubernetes.io/name: swarmwright
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .component }}
{{- end -}}

{{- define "swarmwright.labels" -}}
{{ include "swarmwright.selector" . }}
app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
helm.sh/chart: {{ printf "%s-%s" .root.Chart.Name .root.Chart.Version }}
{{- end -}}

{{/* What the pods of all components have in common. */}}
{{- define "swarmwright.pod" -}}
automountServiceAccountToken: false
enableServiceLinks: false
securityContext: {{- toYaml .Values.podSecurityContext | nindent 2 }}
{{- with .Values.imagePullSecrets }}
imagePullSecrets:
  {{- range . }}
  - name: {{ . }}
  {{- end }}
{{- end }}
{{- with .Values.nodeSelector }}
nodeSelector: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .Values.tolerations }}
tolerations: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .Values.affinity }}
affinity: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .Values.priorityClassName }}
priorityClassName: {{ . }}
{{- end }}
{{- end -}}

{{- define "swarmwright.image" -}}
image: {{ printf "%s:%s" .Values.image.repository (.Values.image.tag | default .Chart.AppVersion) }}
imagePullPolicy: {{ .Values.image.pullPolicy }}
securityContext: {{- toYaml .Values.securityContext | nindent 2 }}
{{- end -}}

{{- define "swarmwright.secret" -}}
{{ required "credentials is missing: the name of a Secret with the files of `swarmwright broker --init`; see values.yaml" .Values.credentials }}
{{- end -}}

{{/* The account of a role, as `swarmwright broker --init --prefix` names it. */}}
{{- define "swarmwright.account" -}}
{{- $stem := regexReplaceAll "[^\\w.-]+" .root.Values.prefix "-" -}}
{{ if $stem }}{{ $stem }}-{{ end }}{{ .role }}
{{- end -}}

{{/* An argument, which --set may have made a number. */}}
{{- define "swarmwright.word" -}}
{{ if kindIs "string" . }}{{ . | quote }}{{ else }}{{ toJson . | quote }}{{ end }}
{{- end -}}

{{/* How a role reaches the broker. */}}
{{- define "swarmwright.environment" -}}
{{- $account := include "swarmwright.account" . -}}
- {name: HOME, value: /tmp}
- {name: SWARMWRIGHT_BROKER, value: "mqtts://{{ include "swarmwright.broker" .root }}:{{ .root.Values.broker.port }}"}
- {name: SWARMWRIGHT_USERNAME, value: {{ $account | quote }}}
- {name: SWARMWRIGHT_PASSWORD_FILE, value: "/etc/swarmwright/{{ $account }}.password"}
- {name: SWARMWRIGHT_CA_FILE, value: /etc/swarmwright/ca.pem}
{{- end -}}
