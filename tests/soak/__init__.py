"""A service under mixed load for hours: what grows although it should not."""
