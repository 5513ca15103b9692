#!/usr/bin/env bash
# A SLURM cluster of two nodes on this machine, without systemd, cgroups and files outside $CLUSTER:
#   CLUSTER=FOLDER slurm.sh start | stop | kill NODE | revive NODE
# Debian: apt-get install --no-install-recommends slurm-wlm munge
set -euo pipefail
: "${CLUSTER:?names the folder of the cluster}"
export SLURM_CONF=$CLUSTER/slurm.conf PATH=$PATH:/usr/sbin
nodes=(node1 node2)
first_port=${CLUSTER_PORT:-27817}

free() { # ends here where a cluster of an earlier run still listens
  if (exec 3<> "/dev/tcp/127.0.0.1/$first_port") 2> /dev/null; then
    echo "slurm.sh: port $first_port is taken, by a cluster that was killed? End its slurmctld, slurmd and munged, or set CLUSTER_PORT" >&2
    exit 1
  fi
}

configure() {
  mkdir -p "$CLUSTER"/{bin,state,log}
  chmod 755 "$CLUSTER" "$CLUSTER"/*/
  (umask 077; head -c 1024 /dev/urandom > "$CLUSTER/munge.key")
  cat > "$SLURM_CONF" <<CONF
ClusterName=rooms
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$first_port
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthInfo=socket=$CLUSTER/munge.socket
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
StateSaveLocation=$CLUSTER/state
SlurmdSpoolDir=$CLUSTER/state/%n
SlurmctldPidFile=$CLUSTER/slurmctld.pid
SlurmdPidFile=$CLUSTER/slurmd.%n.pid
SlurmctldLogFile=$CLUSTER/log/slurmctld.log
SlurmdLogFile=$CLUSTER/log/%n.log
MailProg=/bin/true
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
# a job that takes more memory than it asked for is ended within seconds
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=1
JobAcctGatherParams=OverMemoryKill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
EnforcePartLimits=ALL
ReturnToService=2
SlurmdTimeout=30
KillWait=3
MinJobAge=3600
AccountingStorageType=accounting_storage/none
CONF
  local port=$first_port node
  for node in "${nodes[@]}"; do
    port=$((port + 1))
    echo "NodeName=$node NodeHostname=$(hostname -s) NodeAddr=127.0.0.1 Port=$port CPUs=4 RealMemory=8000" >> "$SLURM_CONF"
  done
  echo "PartitionName=all Nodes=node[1-2] Default=YES MaxTime=1-00:00:00 State=UP" >> "$SLURM_CONF"
  echo "CgroupAutomount=no" > "$CLUSTER/cgroup.conf"
  # the executor takes SLURM_CONF out of the environment of the srun of a job
  printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" > "$CLUSTER/bin/srun"
  chmod 755 "$CLUSTER/bin/srun"
}

patiently() { # COMMAND...: until it succeeds, half a minute at most
  for _ in $(seq 150); do "$@" > /dev/null 2>&1 && return; sleep 0.2; done
  echo "slurm.sh: never succeeded: $*; see $CLUSTER/log" >&2
  exit 1
}

ready() { [ "$(sinfo -h -N -o '%t' | grep -c idle)" = "${#nodes[@]}" ]; }

end() { # PIDFILE SIGNAL
  [ ! -s "$1" ] || kill "-$2" "$(cat "$1")" 2> /dev/null || true
  rm -f "$1"
}

below() { local child; for child in $(pgrep -P "$1"); do below "$child"; echo "$child"; done; }

case ${1:-} in
  start)
    free
    configure
    munged --socket="$CLUSTER/munge.socket" --key-file="$CLUSTER/munge.key" --pid-file="$CLUSTER/munged.pid" \
      --log-file="$CLUSTER/log/munged.log" --seed-file="$CLUSTER/munged.seed" --force 2> /dev/null
    patiently munge -S "$CLUSTER/munge.socket" -n
    slurmctld
    patiently scontrol ping
    for node in "${nodes[@]}"; do slurmd -N "$node"; done
    patiently ready
    ;;
  stop)
    scancel --quiet --user="$(id -un)" 2> /dev/null || true
    for _ in $(seq 50); do [ -n "$(squeue -h 2> /dev/null -t running,completing)" ] || break; sleep 0.2; done
    for node in "${nodes[@]}"; do end "$CLUSTER/slurmd.$node.pid" TERM; done
    end "$CLUSTER/slurmctld.pid" TERM
    end "$CLUSTER/munged.pid" TERM
    ;;
  kill) # as if its power failed: the daemon, the steps of its jobs and all that they started
    victims=("$(cat "$CLUSTER/slurmd.$2.pid")")
    rm -f "$CLUSTER/slurmd.$2.pid"
    for job in $(squeue -h -w "$2" -t running -o %i); do
      for step in $(pgrep -f "^slurmstepd: \[$job\." || true); do
        readlink "/proc/$step/fd/"* 2> /dev/null | grep -q "^$CLUSTER/" && victims+=("$step" $(below "$step"))
      done
    done
    kill -KILL "${victims[@]}" 2> /dev/null || true
    ;;
  revive) slurmd -N "$2" ;;
  *) sed -n '2,4p' "$0" >&2; exit 2 ;;
esac
