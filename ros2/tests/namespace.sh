#!/bin/sh
# Runs a command in this network namespace with loopback and an unconnected interface, outside0.
set -eu
ip link set lo up
ip link add outside0 type veth peer name nowhere0
for interface in outside0 nowhere0; do
    echo 1 > "/proc/sys/net/ipv6/conf/$interface/disable_ipv6"
    ip link set "$interface" up
done
ip address add 192.0.2.1/24 dev outside0
exec "$@"
