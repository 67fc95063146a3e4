# The tables of a study's report in base R: conditions, the planned difference, the mixed model.

trials <- subset(read.csv("study/trials.csv"), practice == 0)
trials$value <- trials$gap_to_optimum_ratio

of_condition <- function(rows) {
  means <- tapply(rows$value, rows$participant, mean)
  parts <- anova(lm(value ~ participant + factor(seed), rows))[["Mean Sq"]]
  data.frame(trials = nrow(rows), drivers = length(means), mean = mean(means),
             between = sqrt(max(0, parts[1] - parts[3]) * length(means) / nrow(rows)), within = sqrt(parts[3]),
             lowest = min(means), highest = max(means))
}
conditions <- do.call(rbind, by(trials, trials$presentation, of_condition))
conditions

same <- c("participant", "seed")
pairs <- merge(subset(trials, presentation == "speed-and-effort"), subset(trials, presentation == "none"), by = same)
pairs$difference <- pairs$value.x - pairs$value.y
drivers <- aggregate(difference ~ participant, pairs, mean)
test <- t.test(drivers$difference)
test

library(nlme)
both <- subset(trials, presentation %in% c("speed-and-effort", "none"))
both$condition <- ifelse(both$presentation == "speed-and-effort", 0.5, -0.5)
model <- lme(value ~ condition + factor(seed) + position, random = ~ condition | participant,
             weights = varIdent(form = ~ 1 | presentation), data = both, na.action = na.omit)
effect <- fixef(model)[["condition"]]
effect + c(-1, 0, 1) * qt(0.975, nrow(drivers) - 1) * sqrt(vcov(model)["condition", "condition"])
VarCorr(model)
