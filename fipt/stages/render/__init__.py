"""The fitted room seen: material maps, re-rendered and relit views."""
